"""The compiled form of dual numbers. Importing this module registers it with numba.

The slopes of a dual number are one LLVM vector, so that an operation costs a few instructions whatever the number of
directions, both when it is compiled and when it is run. All operations are typed by templates and lowered straight to
LLVM instructions, which keeps compilation fast.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typing.templates import signature

from fvswell.compiled import dual
from fvswell.compiled.dual_types import (
    ARITHMETIC,
    COMPARISONS,
    REAL,
    UNARY_FUNCTIONS,
    UNARY_OPERATORS,
    DualType,
    index_of,
    vector_of,
)

__all__ = ["DualType"]


def _scale(builder: ir.IRBuilder, factor: ir.Value, slopes: ir.Value) -> ir.Value:
    """Multiply the slopes by a factor."""
    n = slopes.type.count
    single = builder.insert_element(ir.Constant(slopes.type, ir.Undefined), factor, index_of(0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), n), [0] * n)
    return builder.fmul(builder.shuffle_vector(single, single, mask), slopes)


def _pack(context: Any, builder: ir.IRBuilder, typ: DualType, value: ir.Value, slopes: ir.Value) -> ir.Value:
    """Make a dual number of a value and of slopes."""
    struct = ir.Constant(context.get_value_type(typ), ir.Undefined)
    return builder.insert_value(builder.insert_value(struct, value, 0), slopes, 1)


def _unpack(builder: ir.IRBuilder, typ: types.Type, arg: ir.Value) -> tuple[ir.Value, ir.Value | None]:
    """Return the value and the slopes of an operand, which has no slopes if it is a real number."""
    if isinstance(typ, DualType):
        return builder.extract_value(arg, 0), builder.extract_value(arg, 1)
    return arg, None


def _call(context: Any, builder: ir.IRBuilder, function: Any, *args: ir.Value) -> ir.Value:
    """Call a function of real numbers the way numba does."""
    sig = signature(types.float64, *(types.float64,) * len(args))
    return context.get_function(function, sig)(builder, args)


def _static_power(builder: ir.IRBuilder, value: ir.Value, exponent: int) -> ir.Value:
    """Raise a value to a constant integer power by repeated squaring."""
    result = REAL(1.0)
    square = value
    remaining = abs(exponent)
    while remaining:
        if remaining & 1:
            result = builder.fmul(result, square)
        remaining >>= 1
        if remaining:
            square = builder.fmul(square, square)
    return builder.fdiv(REAL(1.0), result) if exponent < 0 else result


def _power_slope(context: Any, builder: ir.IRBuilder, base: ir.Value, exponent: ir.Value, power: ir.Value) -> ir.Value:
    """Return the derivative of a power with respect to its base.

    It follows from the power by one division, except where the base or the power is zero, infinite or not a number,
    which needs a second power.
    """
    quotient = builder.fdiv(power, base)
    finite = builder.fcmp_ordered("<", _call(context, builder, math.fabs, quotient), REAL(math.inf))
    nonzero = [builder.fcmp_ordered("!=", number, REAL(0.0)) for number in (base, power)]
    regular = builder.and_(finite, builder.and_(*nonzero))
    regular_block = builder.block
    with builder.if_then(builder.not_(regular), likely=False):
        irregular = _call(context, builder, operator.pow, base, builder.fsub(exponent, REAL(1.0)))
        irregular_block = builder.block
    factor = builder.phi(REAL)
    factor.add_incoming(quotient, regular_block)
    factor.add_incoming(irregular, irregular_block)
    constant = builder.fcmp_ordered("==", exponent, REAL(0.0))
    return builder.select(constant, REAL(0.0), builder.fmul(exponent, factor))


def _exponent_slope(context: Any, builder: ir.IRBuilder, base: ir.Value, power: ir.Value) -> ir.Value:
    """Return the derivative of a power with respect to its exponent. It is zero where the power is zero."""
    slope = builder.fmul(power, _call(context, builder, math.log, base))
    return builder.select(builder.fcmp_ordered("==", power, REAL(0.0)), REAL(0.0), slope)


# Typing.


@lower_builtin(dual.dual, types.Float, types.UniTuple)
def _lower_dual(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    slopes = vector_of(builder, cgutils.unpack_tuple(builder, args[1]))
    return _pack(context, builder, sig.return_type, args[0], slopes)


@lower_cast(types.Float, DualType)
@lower_cast(types.Integer, DualType)
@lower_cast(types.Boolean, DualType)
def _lower_cast(context: Any, builder: ir.IRBuilder, fromty: types.Type, toty: DualType, val: ir.Value) -> ir.Value:
    value = context.cast(builder, val, fromty, types.float64)
    return _pack(context, builder, toty, value, vector_of(builder, [REAL(0.0)] * toty.n))


@lower_builtin(dual.constant, types.Float, types.IntegerLiteral)
def _lower_constant(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    return _lower_cast(context, builder, types.float64, sig.return_type, args[0])


@lower_builtin(dual.variables, types.VarArg(types.float64))
def _lower_variables(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    directions = range(len(args))
    units = [vector_of(builder, [REAL(float(i == j)) for j in directions]) for i in directions]
    typ = sig.return_type.dtype
    duals = [_pack(context, builder, typ, value, unit) for value, unit in zip(args, units, strict=True)]
    return context.make_tuple(builder, sig.return_type, duals)


@lower_builtin(dual.value_of, types.Any)
def _lower_value_of(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    return _unpack(builder, sig.args[0], args[0])[0]


@lower_builtin(dual.slope_of, DualType, types.Integer)
def _lower_slope_of(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    return builder.extract_element(builder.extract_value(args[0], 1), args[1])


def _negate(builder: ir.IRBuilder, slopes: ir.Value) -> ir.Value:
    return builder.fsub(ir.Constant(slopes.type, [-0.0] * slopes.type.count), slopes)


def _lower_neg(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    value, slopes = _unpack(builder, sig.args[0], args[0])
    return _pack(context, builder, sig.return_type, builder.fneg(value), _negate(builder, slopes))


def _lower_pos(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    return args[0]


def _lower_abs(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    value, slopes = _unpack(builder, sig.args[0], args[0])
    negative = builder.fcmp_ordered("<", value, REAL(0.0))
    slopes = builder.select(negative, _negate(builder, slopes), slopes)
    return _pack(context, builder, sig.return_type, _call(context, builder, math.fabs, value), slopes)


def _lower_add(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    a, da = _unpack(builder, sig.args[0], args[0])
    b, db = _unpack(builder, sig.args[1], args[1])
    if da is None:
        slopes = db
    elif db is None:
        slopes = da
    else:
        slopes = builder.fadd(da, db)
    return _pack(context, builder, sig.return_type, builder.fadd(a, b), slopes)


def _lower_sub(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    a, da = _unpack(builder, sig.args[0], args[0])
    b, db = _unpack(builder, sig.args[1], args[1])
    if da is None:
        slopes = _negate(builder, db)
    elif db is None:
        slopes = da
    else:
        slopes = builder.fsub(da, db)
    return _pack(context, builder, sig.return_type, builder.fsub(a, b), slopes)


def _combine(builder: ir.IRBuilder, terms: list[tuple[Callable[[], ir.Value], ir.Value | None]]) -> ir.Value:
    """Add the products of factors and slopes, leaving out those of operands that have no slopes."""
    products = [_scale(builder, factor(), slopes) for factor, slopes in terms if slopes is not None]
    return products[0] if len(products) == 1 else builder.fadd(*products)


def _lower_mul(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    a, da = _unpack(builder, sig.args[0], args[0])
    b, db = _unpack(builder, sig.args[1], args[1])
    slopes = _combine(builder, [(lambda: b, da), (lambda: a, db)])
    return _pack(context, builder, sig.return_type, builder.fmul(a, b), slopes)


def _lower_truediv(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    a, da = _unpack(builder, sig.args[0], args[0])
    b, db = _unpack(builder, sig.args[1], args[1])
    value = builder.fdiv(a, b)
    inverse = builder.fdiv(REAL(1.0), b)
    if da is not None and db is not None:
        slopes = _scale(builder, inverse, builder.fsub(da, _scale(builder, value, db)))
    elif da is not None:
        slopes = _scale(builder, inverse, da)
    else:
        slopes = _scale(builder, builder.fmul(builder.fneg(value), inverse), db)
    return _pack(context, builder, sig.return_type, value, slopes)


def _lower_pow(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    a, da = _unpack(builder, sig.args[0], args[0])
    b, db = _unpack(builder, sig.args[1], args[1])
    value = _call(context, builder, operator.pow, a, b)
    slopes = _combine(
        builder,
        [
            (lambda: _power_slope(context, builder, a, b, value), da),
            (lambda: _exponent_slope(context, builder, a, value), db),
        ],
    )
    return _pack(context, builder, sig.return_type, value, slopes)


def _lower_static_pow(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
    value, slopes = _unpack(builder, sig.args[0], args[0])
    exponent = sig.args[1].literal_value
    factor = REAL(0.0)
    if exponent:
        factor = builder.fmul(REAL(float(exponent)), _static_power(builder, value, exponent - 1))
    power = _static_power(builder, value, exponent)
    return _pack(context, builder, sig.return_type, power, _scale(builder, factor, slopes))


def _lower_comparison(symbol: str) -> Callable[..., ir.Value]:
    """Return the lowering of a comparison of values."""

    def lower(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
        compare = builder.fcmp_unordered if symbol == "!=" else builder.fcmp_ordered
        return compare(symbol, *(_unpack(builder, typ, arg)[0] for typ, arg in zip(sig.args, args, strict=True)))

    return lower


def _lower_function(rule: Callable[..., tuple[ir.Value, ir.Value]]) -> Callable[..., ir.Value]:
    """Return the lowering of a function whose value and derivative are given by a rule."""

    def lower(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple[ir.Value, ...]) -> ir.Value:
        argument, slopes = _unpack(builder, sig.args[0], args[0])
        value, derivative = rule(context, builder, argument)
        return _pack(context, builder, sig.return_type, value, _scale(builder, derivative, slopes))

    return lower


def _exp_rule(context: Any, builder: ir.IRBuilder, x: ir.Value) -> tuple[ir.Value, ir.Value]:
    value = _call(context, builder, math.exp, x)
    return value, value


def _log_rule(context: Any, builder: ir.IRBuilder, x: ir.Value) -> tuple[ir.Value, ir.Value]:
    return _call(context, builder, math.log, x), builder.fdiv(REAL(1.0), x)


def _sqrt_rule(context: Any, builder: ir.IRBuilder, x: ir.Value) -> tuple[ir.Value, ir.Value]:
    value = _call(context, builder, math.sqrt, x)
    return value, builder.fdiv(REAL(0.5), value)


def _sinh_rule(context: Any, builder: ir.IRBuilder, x: ir.Value) -> tuple[ir.Value, ir.Value]:
    return _call(context, builder, math.sinh, x), _call(context, builder, math.cosh, x)


def _cosh_rule(context: Any, builder: ir.IRBuilder, x: ir.Value) -> tuple[ir.Value, ir.Value]:
    return _call(context, builder, math.cosh, x), _call(context, builder, math.sinh, x)


def _tanh_rule(context: Any, builder: ir.IRBuilder, x: ir.Value) -> tuple[ir.Value, ir.Value]:
    value = _call(context, builder, math.tanh, x)
    return value, builder.fsub(REAL(1.0), builder.fmul(value, value))


def _register_lowerings() -> None:
    """Register the lowering of every operation for every combination of operand types."""
    unary = (_lower_neg, _lower_pos, _lower_abs, _lower_neg, _lower_abs)
    for function, lower in zip(UNARY_OPERATORS, unary, strict=True):
        lower_builtin(function, DualType)(lower)
    rules = (_exp_rule, _log_rule, _sqrt_rule, _sinh_rule, _cosh_rule, _tanh_rule)
    for function, rule in zip(UNARY_FUNCTIONS, rules, strict=True):
        lower_builtin(function, DualType)(_lower_function(rule))
    binary = {function: _lower_comparison(symbol) for function, symbol in COMPARISONS.items()}
    for functions, lower in zip(
        ARITHMETIC, (_lower_add, _lower_sub, _lower_mul, _lower_truediv, _lower_pow), strict=True
    ):
        binary.update(dict.fromkeys(functions, lower))
    for function, lower in binary.items():
        for operands in ((DualType, DualType), (DualType, types.Float), (types.Float, DualType)):
            lower_builtin(function, *operands)(lower)
    for function in (operator.pow, operator.ipow):
        lower_builtin(function, DualType, types.IntegerLiteral)(_lower_static_pow)


_register_lowerings()

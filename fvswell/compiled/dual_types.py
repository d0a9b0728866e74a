"""Dual numbers as numba types: how they are laid out, and what type every operation on them has.

The slopes of a dual number are one LLVM vector, so that an operation costs a few instructions whatever the number of
directions, both when it is compiled and when it is run.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

from fvswell.compiled import dual

__all__ = [
    "ARITHMETIC",
    "COMPARISONS",
    "LARGEST_STATIC_POWER",
    "REAL",
    "UNARY_FUNCTIONS",
    "UNARY_OPERATORS",
    "DualType",
]

REAL = ir.DoubleType()
UNARY_OPERATORS: tuple[Any, ...] = (operator.neg, operator.pos, abs, np.negative, np.absolute)
UNARY_FUNCTIONS: tuple[Any, ...] = (np.exp, np.log, np.sqrt, np.sinh, np.cosh, np.tanh)
ARITHMETIC: tuple[tuple[Any, Any], ...] = (
    (operator.add, operator.iadd),
    (operator.sub, operator.isub),
    (operator.mul, operator.imul),
    (operator.truediv, operator.itruediv),
    (operator.pow, operator.ipow),
)
COMPARISONS: dict[Any, str] = {
    operator.lt: "<",
    operator.le: "<=",
    operator.gt: ">",
    operator.ge: ">=",
    operator.eq: "==",
    operator.ne: "!=",
}
LARGEST_STATIC_POWER = 64


def index_of(i: int) -> ir.Constant:
    return ir.Constant(ir.IntType(32), i)


def vector_of(builder: ir.IRBuilder, elements: list[ir.Value]) -> ir.Value:
    """Collect elements in a vector."""
    vector = ir.Constant(ir.VectorType(REAL, len(elements)), [0.0] * len(elements))
    for i, element in enumerate(elements):
        vector = builder.insert_element(vector, element, index_of(i))
    return vector


class DualType(types.Type):
    """The numba type of a dual number.

    Parameters
    ----------
    n : int
        The number of directions.
    """

    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(name=f"Dual({n})")

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Conversion | None:
        """Allow the conversion of a real number to a dual number without slopes."""
        return Conversion.safe if _is_real(other) else None

    def unify(self, typingctx: Any, other: types.Type) -> types.Type | None:
        """Let a variable that is a real number in one branch and a dual number in another one be a dual number."""
        return self if _is_real(other) else None


class _SlopesType(types.Type):
    """The numba type of the slopes of a dual number."""

    def __init__(self, n: int) -> None:
        self.n = n
        super().__init__(name=f"Slopes({n})")


@register_default(_SlopesType)
class _SlopesModel(models.PrimitiveModel):
    """The slopes are a vector in registers, and an array in memory, which needs no special alignment."""

    def __init__(self, dmm: Any, fe_type: _SlopesType) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(REAL, fe_type.n))

    def get_data_type(self) -> ir.Type:
        return ir.ArrayType(REAL, self._fe_type.n)

    def as_data(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        data = cgutils.get_null_value(self.get_data_type())
        for i in range(self._fe_type.n):
            data = builder.insert_value(data, builder.extract_element(value, index_of(i)), i)
        return data

    def from_data(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        return vector_of(builder, [builder.extract_value(value, i) for i in range(self._fe_type.n)])


@register_default(DualType)
class _DualModel(models.StructModel):
    def __init__(self, dmm: Any, fe_type: DualType) -> None:
        super().__init__(dmm, fe_type, [("value", types.float64), ("slopes", _SlopesType(fe_type.n))])


# Pieces of LLVM code.


def _is_real(typ: types.Type) -> bool:
    return isinstance(typ, types.Float | types.Integer | types.Boolean)


def _operand_types(args: tuple[types.Type, ...]) -> tuple[int, list[types.Type]] | None:
    """Return the number of directions and the operand types of an operation in which a dual number takes part."""
    sizes = {arg.n for arg in args if isinstance(arg, DualType)}
    if len(sizes) != 1 or not all(isinstance(arg, DualType) or _is_real(arg) for arg in args):
        return None
    return sizes.pop(), [arg if isinstance(arg, DualType) else types.float64 for arg in args]


class _UnaryTemplate(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        if len(args) == 1 and isinstance(args[0], DualType):
            return signature(args[0], args[0])
        return None


class _ArithmeticTemplate(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        operands = _operand_types(args) if len(args) == 2 else None
        return signature(DualType(operands[0]), *operands[1]) if operands else None


class _PowerTemplate(_ArithmeticTemplate):
    prefer_literal = True

    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        if (
            len(args) == 2
            and isinstance(args[0], DualType)
            and isinstance(args[1], types.IntegerLiteral)
            and abs(args[1].literal_value) <= LARGEST_STATIC_POWER
        ):
            return signature(args[0], *args)
        return super().generic(args, kws)


class _ComparisonTemplate(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        operands = _operand_types(args) if len(args) == 2 else None
        return signature(types.boolean, *operands[1]) if operands else None


def _register_templates() -> None:
    """Register one template for each operation. Numba writes the key of the operation into the class."""

    def register(function: Any, base: type) -> None:
        infer_global(function)(type(f"_Dual_{function.__name__}", (base,), {}))

    for function in (*UNARY_OPERATORS, *UNARY_FUNCTIONS):
        register(function, _UnaryTemplate)
    for functions in ARITHMETIC:
        for function in functions:
            register(function, _PowerTemplate if function in (operator.pow, operator.ipow) else _ArithmeticTemplate)
    for function in COMPARISONS:
        register(function, _ComparisonTemplate)


_register_templates()


@infer_global(dual.dual)
class _DualTemplate(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        if len(args) == 2 and _is_real(args[0]) and isinstance(args[1], types.BaseTuple):
            n = len(args[1])
            return signature(DualType(n), types.float64, types.UniTuple(types.float64, n))
        return None


@infer_global(dual.constant)
class _ConstantTemplate(AbstractTemplate):
    prefer_literal = True

    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        if len(args) == 2 and _is_real(args[0]) and isinstance(args[1], types.IntegerLiteral):
            return signature(DualType(args[1].literal_value), types.float64, args[1])
        return None


@infer_global(dual.variables)
class _VariablesTemplate(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        if args and all(_is_real(arg) for arg in args):
            n = len(args)
            return signature(types.UniTuple(DualType(n), n), *(types.float64,) * n)
        return None


@infer_global(dual.value_of)
class _ValueOfTemplate(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        if len(args) != 1:
            return None
        if isinstance(args[0], DualType):
            return signature(types.float64, args[0])
        return signature(args[0], args[0]) if _is_real(args[0]) else None


@infer_global(dual.slope_of)
class _SlopeOfTemplate(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
        if len(args) == 2 and isinstance(args[0], DualType) and isinstance(args[1], types.Integer):
            return signature(types.float64, args[0], types.intp)
        return None


# Lowering.

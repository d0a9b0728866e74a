"""Dual numbers: a value together with its first derivatives along a fixed number of directions.

A function written with ordinary arithmetic and ``np.exp``, ``np.log``, ``np.sqrt``, ``np.sinh``, ``np.cosh``,
``np.tanh``, ``abs`` and ``**`` gives its value and its exact derivatives when it is called with dual numbers. The
same functions can be compiled with numba after ``import dual_numba``.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Real: TypeAlias = "float | np.floating[Any] | NDArray[np.float64]"
Operand: TypeAlias = "Dual | Real"

__all__ = ["Dual", "constant", "dual", "slope_of", "value_of", "variables"]


class Dual:
    """A value and its first derivatives.

    Parameters
    ----------
    value : float or ndarray
        The value.
    slopes : tuple of float or ndarray
        The derivatives of the value, one for each direction.
    """

    __slots__ = ("slopes", "value")

    value: Real
    slopes: tuple[Real, ...]

    def __init__(self, value: Real, slopes: tuple[Real, ...]) -> None:
        self.value = value
        self.slopes = slopes

    def __repr__(self) -> str:
        return f"Dual({self.value!r}, {self.slopes!r})"

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        rule = _UFUNC_RULES.get(ufunc)
        if rule is None or method != "__call__" or kwargs:
            return NotImplemented
        return rule(*inputs)

    def _chain(self, value: Real, factor: Real) -> Dual:
        """Return the dual number with the given value and with the slopes of this one times a factor."""
        return Dual(value, tuple(factor * slope for slope in self.slopes))

    def __neg__(self) -> Dual:
        return Dual(-self.value, tuple(-slope for slope in self.slopes))

    def __pos__(self) -> Dual:
        return self

    def __abs__(self) -> Dual:
        return self._chain(np.abs(self.value), np.where(np.less(self.value, 0.0), -1.0, 1.0)[()])

    def __add__(self, other: Operand) -> Dual:
        if isinstance(other, Dual):
            slopes = tuple(a + b for a, b in zip(self.slopes, other.slopes, strict=True))
            return Dual(self.value + other.value, slopes)
        return Dual(self.value + other, self.slopes)

    __radd__ = __add__

    def __sub__(self, other: Operand) -> Dual:
        if isinstance(other, Dual):
            slopes = tuple(a - b for a, b in zip(self.slopes, other.slopes, strict=True))
            return Dual(self.value - other.value, slopes)
        return Dual(self.value - other, self.slopes)

    def __rsub__(self, other: Real) -> Dual:
        return Dual(other - self.value, tuple(-slope for slope in self.slopes))

    def __mul__(self, other: Operand) -> Dual:
        if isinstance(other, Dual):
            slopes = tuple(a * other.value + self.value * b for a, b in zip(self.slopes, other.slopes, strict=True))
            return Dual(self.value * other.value, slopes)
        return self._chain(self.value * other, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Operand) -> Dual:
        if isinstance(other, Dual):
            value = np.divide(self.value, other.value)
            inverse = np.divide(1.0, other.value)
            slopes = tuple((a - value * b) * inverse for a, b in zip(self.slopes, other.slopes, strict=True))
            return Dual(value, slopes)
        return self._chain(np.divide(self.value, other), np.divide(1.0, other))

    def __rtruediv__(self, other: Real) -> Dual:
        value = np.divide(other, self.value)
        return self._chain(value, -value * np.divide(1.0, self.value))

    def __pow__(self, exponent: Operand) -> Dual:
        if isinstance(exponent, Dual):
            value = _power(self.value, exponent.value)
            along_base = _power_slope(self.value, exponent.value)
            along_exponent = _exponent_slope(self.value, value)
            slopes = tuple(
                along_base * a + along_exponent * b for a, b in zip(self.slopes, exponent.slopes, strict=True)
            )
            return Dual(value, slopes)
        return self._chain(_power(self.value, exponent), _power_slope(self.value, exponent))

    def __rpow__(self, base: Real) -> Dual:
        value = _power(base, self.value)
        return self._chain(value, _exponent_slope(base, value))

    def __lt__(self, other: Operand) -> Any:
        return self.value < value_of(other)

    def __le__(self, other: Operand) -> Any:
        return self.value <= value_of(other)

    def __gt__(self, other: Operand) -> Any:
        return self.value > value_of(other)

    def __ge__(self, other: Operand) -> Any:
        return self.value >= value_of(other)

    def __eq__(self, other: Any) -> Any:
        return self.value == value_of(other)

    def __ne__(self, other: Any) -> Any:
        return self.value != value_of(other)

    __hash__ = None  # type: ignore[assignment]


def dual(value: Real, slopes: tuple[Real, ...]) -> Dual:
    """Return a dual number with a given value and given slopes.

    Parameters
    ----------
    value : float or ndarray
        The value.
    slopes : tuple of float or ndarray
        The derivatives of the value, one for each direction.

    Returns
    -------
    Dual
        The dual number.
    """
    return Dual(value, slopes)


def constant(value: Real, n: int) -> Dual:
    """Return a dual number whose slopes are all zero.

    Parameters
    ----------
    value : float or ndarray
        The value.
    n : int
        The number of directions. It must be a literal in compiled code.

    Returns
    -------
    Dual
        The dual number.
    """
    return Dual(value, (0.0,) * n)


def variables(*values: Real) -> tuple[Dual, ...]:
    """Return the independent variables of a differentiation.

    Parameters
    ----------
    *values : float or ndarray
        The values of the variables.

    Returns
    -------
    tuple of Dual
        As many dual numbers as values. The i-th one has a unit slope in direction i and zero slopes elsewhere.
    """
    n = len(values)
    return tuple(Dual(value, tuple(float(i == j) for j in range(n))) for i, value in enumerate(values))


def value_of(x: Any) -> Any:
    """Return the value of a dual number, or the argument itself if it is not a dual number.

    Parameters
    ----------
    x : Dual, float or ndarray
        The number.

    Returns
    -------
    float or ndarray
        The value.
    """
    return x.value if isinstance(x, Dual) else x


def slope_of(x: Dual, i: int) -> Real:
    """Return the slope of a dual number in one direction.

    Parameters
    ----------
    x : Dual
        The number.
    i : int
        The direction, counted from zero.

    Returns
    -------
    float or ndarray
        The slope.
    """
    return x.slopes[i]


def _power(base: Real, exponent: Real) -> Any:
    """Return a power in floating point, whatever the types of the base and of the exponent."""
    return np.power(np.asarray(base, dtype=np.float64)[()], exponent)


def _power_slope(base: Real, exponent: Real) -> Any:
    """Return the derivative of a power with respect to the base. It is zero for a zero exponent."""
    with np.errstate(all="ignore"):
        slope = exponent * _power(base, np.subtract(exponent, 1.0))
    return np.where(np.equal(exponent, 0.0), 0.0, slope)[()]


def _exponent_slope(base: Real, power: Real) -> Any:
    """Return the derivative of a power with respect to the exponent. It is zero where the power is zero."""
    with np.errstate(all="ignore"):
        slope = power * np.log(base)
    return np.where(np.equal(power, 0.0), 0.0, slope)[()]


def _reflected(forward: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a binary operation that hands an array on the left-hand side to the reflected method of Dual."""
    name = forward.__name__
    reflected = {"lt": "gt", "le": "ge", "gt": "lt", "ge": "le", "eq": "eq", "ne": "ne"}.get(name, f"r{name}")

    def operation(left: Any, right: Any) -> Any:
        if isinstance(left, Dual):
            return forward(left, right)
        return getattr(right, f"__{reflected}__")(left)

    return operation


def _exp(x: Dual) -> Dual:
    value = np.exp(x.value)
    return x._chain(value, value)


def _log(x: Dual) -> Dual:
    return x._chain(np.log(x.value), np.divide(1.0, x.value))


def _sqrt(x: Dual) -> Dual:
    value = np.sqrt(x.value)
    return x._chain(value, np.divide(0.5, value))


def _sinh(x: Dual) -> Dual:
    return x._chain(np.sinh(x.value), np.cosh(x.value))


def _cosh(x: Dual) -> Dual:
    return x._chain(np.cosh(x.value), np.sinh(x.value))


def _tanh(x: Dual) -> Dual:
    value = np.tanh(x.value)
    return x._chain(value, 1.0 - value * value)


_UFUNC_RULES: dict[np.ufunc, Callable[..., Any]] = {
    np.add: _reflected(operator.add),
    np.subtract: _reflected(operator.sub),
    np.multiply: _reflected(operator.mul),
    np.true_divide: _reflected(operator.truediv),
    np.power: _reflected(operator.pow),
    np.less: _reflected(operator.lt),
    np.less_equal: _reflected(operator.le),
    np.greater: _reflected(operator.gt),
    np.greater_equal: _reflected(operator.ge),
    np.equal: _reflected(operator.eq),
    np.not_equal: _reflected(operator.ne),
    np.negative: operator.neg,
    np.positive: operator.pos,
    np.absolute: operator.abs,
    np.exp: _exp,
    np.log: _log,
    np.sqrt: _sqrt,
    np.sinh: _sinh,
    np.cosh: _cosh,
    np.tanh: _tanh,
}

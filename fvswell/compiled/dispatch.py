"""Functions of a point: plain Python that compiled kernels can call as well.

Importing numba takes a third of a second, so nothing here imports it. Functions are noted down, and numba is given
them when the first kernel is compiled.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Protocol, TypeVar, cast

import numpy as np

__all__ = ["Generic", "anywhere", "generic", "give_to_numba", "law_at", "noted_functions", "point"]

_Function = TypeVar("_Function", bound=Callable[..., Any])

# arrays are not counted (kernels allocate nothing), and only kernels are called from Python: both save compile time
_OPTIONS = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True, "no_cpython_wrapper": True}

_noted: list[Callable[..., Any]] = []  # in the order of their definition
_generic: list[Generic] = []
_given = 0
_given_generic = 0
_given_others = False


def point(function: _Function) -> _Function:
    """Mark a function of a point, which compiled kernels may call; in Python it stays as it is.

    It takes and returns floats, arrays, complex or dual numbers, and calls numpy's functions (``np.exp``).
    """
    _noted.append(function)
    return function


class Generic(Protocol):
    """A function that is chosen by the type of its first argument."""

    implementations: dict[type, Callable[..., Any]]

    def register(self, law: type) -> Callable[[_Function], _Function]:
        """Decorate the implementation for laws of a type."""

    def __call__(self, law: Any, *arguments: Any) -> Any:
        """Call the implementation for the type of the law."""


def generic(function: Callable[..., Any]) -> Generic:
    """Make a function whose implementation is chosen by the type of its first argument, in Python and in kernels.

    The body of the decorated function is not used; its signature and docstring are what every implementation keeps to.
    A new law is a NamedTuple of its own parameters and one implementation of each generic function:

        @stress_coefficients.register(MyLaw)
        def _my_law(law, J, first, second, fluid_fraction): ...

    What is registered for `object` holds for all laws that have nothing of their own.
    """
    implementations: dict[type, Callable[..., Any]] = {}

    @functools.wraps(function)
    def dispatch(law: Any, *arguments: Any) -> Any:
        own = type(law)
        return implementations[own if own in implementations else object](law, *arguments)

    def register(law: type) -> Callable[[_Function], _Function]:
        def add(implementation: _Function) -> _Function:
            implementations[law] = point(implementation)
            return implementation

        return add

    chosen: Any = dispatch
    chosen.implementations, chosen.register = implementations, register
    _generic.append(chosen)
    generic_function: Generic = chosen
    return generic_function


def law_at(law: Any, parameters: Any, first: int, index: int) -> Any:
    """A law with its parameters at one point, from the rows of an array that begin with ``first``."""
    return law(*parameters[first : first + len(law._fields), index])


def _typed_law_at(law: Any, parameters: Any, first: Any, index: Any) -> Any:
    """What numba compiles for `law_at`: the constructor of the law, written out."""
    fields = law.instance_class._fields
    values = ", ".join(f"parameters[first + {row}, index]" for row in range(len(fields)))
    space: dict[str, Any] = {"law_class": law.instance_class}
    exec(f"def construct(law, parameters, first, index):\n    return law_class({values})", space)
    return space["construct"]


def anywhere(condition: Any) -> Any:
    """Whether a condition holds: at one point, or at any of many. In kernels there is but one."""
    return np.any(condition)


def _typed_anywhere(condition: Any) -> Any:
    """What numba compiles for `anywhere`."""
    return lambda condition: condition


def noted_functions() -> list[Callable[..., Any]]:
    """All functions of a point that have been defined, laws of users included."""
    return list(_noted)


def give_to_numba() -> None:
    """Make everything noted so far callable from compiled code; what numba has already got is left out."""
    global _given, _given_generic, _given_others
    from numba.extending import overload, register_jitable

    from fvswell.compiled import dual_numba  # noqa: F401  registers dual numbers

    for function in _noted[_given:]:
        register_jitable(**_OPTIONS)(function)
    _given = len(_noted)
    for dispatch in _generic[_given_generic:]:
        overload(dispatch, strict=False, jit_options=cast(Any, _OPTIONS))(_typed(dispatch))
    _given_generic = len(_generic)
    if not _given_others:
        overload(law_at, strict=False)(_typed_law_at)
        overload(anywhere, strict=False)(_typed_anywhere)
        _given_others = True


def _typed(dispatch: Generic) -> Callable[..., Any]:
    """What numba asks for the implementation of a generic function, given the types of the arguments."""

    def choose(law: Any, *arguments: Any) -> Any:
        own, implementations = law.instance_class, dispatch.implementations
        return implementations[own if own in implementations else object]

    return choose

"""Solids with families of fibres beside a ground substance.

`with_fibres` gives a law of the solid like any other: a NamedTuple of numbers, the parameters of the ground substance
under their own names and those of each family with its number behind, such as ``modulus_1``. There is one class for
each combination of a ground substance with families, so kernels are compiled for what a tissue has and for no more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import point
from fvswell.physics.fibre_directions import SecondPiola, axial_fibre_stress, fibre_stress, mean_fibre_stress
from fvswell.physics.solids import (
    SolidStress,
    bulk_modulus,
    cauchy_stress,
    isotropic_stress,
    piola_stress,
    shear_modulus,
    uniaxial_stress,
)

__all__ = ["FibreFamily", "ground_and_families", "with_fibres"]


class FibreFamily(NamedTuple):
    """A family: one of `FIBRE_DIRECTIONS` and one of `FIBRE_LAWS`, each with its parameters."""

    directions: Any
    law: Any


def with_fibres(ground: Any, families: Sequence[FibreFamily]) -> Any:
    """A solid with families of fibres in tension; without families, the ground substance itself.

    Parameters
    ----------
    ground
        An isotropic law of `fvswell.physics.solids`.
    families
        Each with an amount of its own; parameters may vary in space as those of the ground substance may.
    """
    if not families:
        return ground
    kinds = tuple((type(family.directions), type(family.law)) for family in families)
    numbers = [number for family in families for part in family for number in part]
    kind: Any = type(ground)
    return _solid_class(kind, kinds)(*ground, *numbers)


def ground_and_families(solid: Any) -> tuple[Any, tuple[FibreFamily, ...]]:
    """The parts of a solid; of one without fibres, itself."""
    if type(solid) not in _PARTS:
        return solid, ()
    ground, kinds = _PARTS[type(solid)]
    numbers = iter(solid)

    def part(law: Any) -> Any:
        return law(*(next(numbers) for _ in law._fields))

    return part(ground), tuple(FibreFamily(part(directions), part(law)) for directions, law in kinds)


_Function = Callable[..., Any]
_Kinds = tuple[tuple[Any, Any], ...]
_PARTS: dict[type, tuple[Any, _Kinds]] = {}


@cache
def _solid_class(ground: Any, kinds: _Kinds) -> Any:
    """The class of a ground substance with families, and its stresses."""
    fields = [*ground._fields]
    for number, kind in enumerate(kinds, start=1):
        fields += [f"{field}_{number}" for part in kind for field in part._fields]
    name = "With".join([ground.__name__, *(directions.__name__ + law.__name__ for directions, law in kinds)])
    solid: Any = NamedTuple(name, [(field, Any) for field in fields])  # type: ignore[misc]
    solid.__doc__ = f"{ground.__name__} with fibres in tension."
    solid.__module__ = __name__
    globals()[name] = solid  # where numba's cache looks for a class, which it knows by its name
    # another process has to make the class
    solid.__reduce__ = lambda self: (with_fibres, ground_and_families(self))  # type: ignore[method-assign]
    _PARTS[solid] = ground, kinds
    _register(solid, ground, kinds)
    return solid


def _register(solid: Any, ground: Any, kinds: _Kinds) -> None:
    """Implement what a solid is asked for as that of its ground substance and the sum over its families."""
    read_ground, first = _reader(ground, 0)
    families = []
    for directions, law in kinds:
        read_directions, first = _reader(directions, first)
        read_law, first = _reader(law, first)
        families.append((read_directions, read_law))
    components, axial = _total(families, fibre_stress, _sum_of_components), _total(families, axial_fibre_stress, _sum)
    equal = _total(families, mean_fibre_stress, _sum)

    @cauchy_stress.register(solid)
    def cauchy(solid: Any, fluid_fraction: Any, F: Any) -> Any:
        xx, xy, yx, yy, zz = F
        S = components(solid, *_right_cauchy_green(F))
        own, J = cauchy_stress(read_ground(solid), fluid_fraction, F), (xx * yy - xy * yx) * zz
        return SolidStress(
            own.xx + (xx * xx * S.xx + 2.0 * xx * xy * S.xy + xy * xy * S.yy) / J,
            own.yy + (yx * yx * S.xx + 2.0 * yx * yy * S.xy + yy * yy * S.yy) / J,
            own.zz + zz * zz * S.zz / J,
            own.xy + (xx * yx * S.xx + (xx * yy + xy * yx) * S.xy + xy * yy * S.yy) / J,
        )

    @piola_stress.register(solid)
    def piola(solid: Any, fluid_fraction: Any, F: Any) -> Any:
        """P = F S for the fibres."""
        xx, xy, yx, yy, zz = F
        S = components(solid, *_right_cauchy_green(F))
        own = piola_stress(read_ground(solid), fluid_fraction, F)
        return (
            own[0] + (xx * S.xx + xy * S.xy), own[1] + (xx * S.xy + xy * S.yy), own[2] + (yx * S.xx + yy * S.xy),
            own[3] + (yx * S.xy + yy * S.yy), own[4] + zz * S.zz,
        )  # fmt: skip

    @uniaxial_stress.register(solid)
    def uniaxial(solid: Any, J: Any, fluid_fraction: Any) -> Any:
        return uniaxial_stress(read_ground(solid), J, fluid_fraction) + J * axial(solid, J * J)

    @isotropic_stress.register(solid)
    def isotropic(solid: Any, J: Any, fluid_fraction: Any) -> Any:
        square = np.exp(2.0 / 3.0 * np.log(J))
        return isotropic_stress(read_ground(solid), J, fluid_fraction) + square / J * equal(solid, square)

    @bulk_modulus.register(solid)
    def bulk(solid: Any, fluid_fraction: Any) -> Any:
        return bulk_modulus(read_ground(solid), fluid_fraction)

    @shear_modulus.register(solid)
    def shear(solid: Any, fluid_fraction: Any) -> Any:
        return shear_modulus(read_ground(solid), fluid_fraction)


def _reader(part: Any, first: int) -> tuple[_Function, int]:
    """What finds a part of a solid among its numbers, and where they end."""
    last = first + len(part._fields)

    @point
    def read(solid: Any) -> Any:
        return part(*solid[first:last])

    return read, last


def _total(families: list[tuple[_Function, _Function]], stress: _Function, add: _Function) -> _Function:
    """A stress summed over families; kernels have the sum written out."""
    (directions, law), *others = families

    @point
    def own(solid: Any, *where: Any) -> Any:
        return stress(directions(solid), law(solid), *where)

    if not others:
        return own
    more = _total(others, stress, add)

    @point
    def total(solid: Any, *where: Any) -> Any:
        return add(own(solid, *where), more(solid, *where))

    return total


@point
def _sum(first: Any, second: Any) -> Any:
    return first + second


@point
def _sum_of_components(first: Any, second: Any) -> Any:
    return SecondPiola(first.xx + second.xx, first.yy + second.yy, first.zz + second.zz, first.xy + second.xy)


@point
def _right_cauchy_green(F: Any) -> Any:
    """C = F^T F, components (xx, yy, zz, xy)."""
    xx, xy, yx, yy, zz = F
    return xx * xx + yx * yx, xy * xy + yy * yy, zz * zz, xx * xy + yx * yy

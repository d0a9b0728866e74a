"""Confined compression of a biphasic layer at small strain: creep and stress relaxation.

Terzaghi's consolidation, in the form of Mow, Kuei, Lai & Armstrong (1980). The layer drains at x = 0 into a
filter; the piston at x = h is impermeable. Arguments are numbers or arrays that broadcast; units mm, N, s.
"""

from __future__ import annotations

from fvswell.exact.slab import mean_uptake, profile_uptake, ramp_influx
from fvswell.physics.tissue import Array

__all__ = ["creep_fluid_pressure", "creep_strain", "relaxation_pressure"]


def creep_strain(
    aggregate_modulus: Array | float,
    permeability: Array | float,
    height: Array | float,
    piston_pressure: Array | float,
    time: Array,
) -> Array:
    """Strain of the layer (negative) a time after the piston's pressure came on at once.

    -(P/H) [1 - sum 2/lambda_n^2 exp(-lambda_n^2 H k t/h^2)], lambda_n = (n + 1/2) pi.
    """
    scaled_time = aggregate_modulus * permeability * time / height**2
    return -piston_pressure / aggregate_modulus * mean_uptake(scaled_time)


def creep_fluid_pressure(
    aggregate_modulus: Array | float,
    permeability: Array | float,
    height: Array | float,
    piston_pressure: Array | float,
    position: Array,
    time: Array,
) -> Array:
    """Fluid pressure p (MPa) in creep at ``position`` mm from the filter; the strain there is (p - P)/H."""
    scaled_time = aggregate_modulus * permeability * time / height**2
    return piston_pressure * (1.0 - profile_uptake(position / height, scaled_time))


def relaxation_pressure(
    aggregate_modulus: Array | float,
    permeability: Array | float,
    height: Array | float,
    displacement: Array | float,
    ramp_duration: Array | float,
    time: Array,
) -> Array:
    """Pressure on a piston (MPa) that moves in by ``displacement`` (mm) at one speed, then stands still.

    The displacement relative to the piston diffuses with H k; it is given at the filter, where the fluid's
    pressure is zero and the solid carries the load -H du/dx. While the piston moves,

        P = (V h/k) [tau + 1/3 - sum 2/(n pi)^2 exp(-(n pi)^2 tau)],   tau = H k t/h^2,

    V being the speed, and afterwards the same less its value one ``ramp_duration`` (s) ago; in the end H
    displacement/h.
    """
    rate = aggregate_modulus * permeability / height**2
    moving = ramp_influx(rate * time) - ramp_influx(rate * (time - ramp_duration))
    return displacement / ramp_duration * height / permeability * moving

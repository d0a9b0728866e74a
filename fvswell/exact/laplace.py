"""From Laplace transforms back to time, and answers to steps, ramps and sines from a transfer function.

A transfer function T(s) is the Laplace transform of what a linear system answers to a unit impulse. Its transform is
inverted by the trapezoidal rule along a hyperbola that bends around the singularities, which must lie near the
negative real axis (Weideman & Trefethen 2007, with their parameters for one time): the error falls tenfold with each
node, to a few units of rounding with the nodes here.

Arrays of s have shape ``(rows, times, nodes)``, where rows may be 1; transforms return the same shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["TransferAnswers", "Transform", "inverse"]

Transform = Callable[[Array], Array]

_NODES = 12
_STEP, _SCALE, _ANGLE = 1.081792140, 4.492075287, 1.172104229  # h N, mu t/N and alpha of the source


def _contour(nodes: int) -> tuple[Array, Array]:
    """Nodes s t in the upper half plane, and the weights of the transform there, times 1/t."""
    u = (np.arange(nodes) + 0.5) * _STEP / nodes
    scale = _SCALE * nodes
    points = scale * (1.0 + np.sin(1j * u - _ANGLE))
    return points, np.exp(points) * scale * 1j * np.cos(1j * u - _ANGLE) * _STEP / (nodes * np.pi)


_POINTS, _WEIGHTS = _contour(_NODES)


def inverse(transform: Transform, time: Array) -> Array:
    """Function of time with a given Laplace transform.

    Parameters
    ----------
    transform
        Of a real function; its singularities lie near the negative real axis.
    time
        s, shape ``(rows, times)``; up to time 0 the function is 0.

    Returns
    -------
    array
        Shape ``(rows, times)``.
    """
    after = time > 0.0
    late = np.where(after, time, 1.0)[..., None]
    values = (transform(_POINTS / late) * _WEIGHTS).imag.sum(axis=-1)
    return np.where(after, values / late[..., 0], 0.0)


@dataclass(frozen=True)
class TransferAnswers:
    """Answers to histories that begin at time 0, from the transfer function of a system initially at rest."""

    transfer: Transform

    def step(self, time: Array) -> Array:
        """Answer to a unit step, shape of ``time``, ``(rows, times)``."""
        return inverse(lambda s: self.transfer(s) / s, time)

    def ramp(self, time: Array) -> Array:
        """Answer to a ramp of unit slope, shape of ``time``, ``(rows, times)``."""
        return inverse(lambda s: self.transfer(s) / (s * s), time)

    def sine(self, time: Array, angular_frequency: float, phase: Array | float) -> Array:
        """Answer to sin(omega t + phase) from time 0 on, ``(rows, times)`` as ``time``; a phase or ``(rows, 1)``.

        The steady answer is known, Im T(i omega) exp(i (omega t + phase)); the rest, which dies away, is inverted.
        """
        steady = self.frequency_response(angular_frequency)[:, None] * np.exp(1j * np.reshape(phase, (-1, 1)))
        sine, cosine = np.sin(np.reshape(phase, (-1, 1, 1))), np.cos(np.reshape(phase, (-1, 1, 1)))

        def transient(s: Array) -> Array:
            drive = self.transfer(s) * (s * sine + angular_frequency * cosine)
            left = drive - (s * steady.imag[..., None] + angular_frequency * steady.real[..., None])
            return left / (s * s + angular_frequency**2)

        value = (steady * np.exp(1j * angular_frequency * time)).imag + inverse(transient, time)
        return np.where(time > 0.0, value, 0.0)

    def frequency_response(self, angular_frequency: float) -> Array:
        """Complex amplitude T(i omega), shape ``(rows,)``."""
        return self.transfer(np.full((1, 1, 1), 1j * angular_frequency))[:, 0, 0]

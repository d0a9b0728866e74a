"""How well the balances close: what a record of the integrator says of them."""

from __future__ import annotations

import numpy as np

from fvswell.numerics.state import Record
from fvswell.physics.tissue import Array

__all__ = ["balance_errors"]


def balance_errors(record: Record, ions: bool) -> dict[str, Array]:
    """Errors of the balances at the outputs, relative to what has crossed the boundary, ``(outputs,)`` each.

    Of volume, anions and cations the largest mismatch in a step since the last output; of charge, which no cell stores,
    the net charge that has crossed, relative to the cations that did. Those of ions only where they are transported.
    """
    outputs = int(record.filled[0])
    errors = {"volume_balance_error": record.errors[:outputs, 0].copy()}
    if ions:
        crossed = record.crossed[:outputs].sum(axis=1)
        net, through = np.abs(crossed[:, 2] - crossed[:, 1]), np.abs(record.crossed[:outputs, :, 2]).sum(axis=1)
        errors |= {
            "anion_balance_error": record.errors[:outputs, 1].copy(),
            "cation_balance_error": record.errors[:outputs, 2].copy(),
            "charge_balance_error": np.divide(net, through, out=np.zeros(outputs), where=through > 0.0),
        }
    return errors

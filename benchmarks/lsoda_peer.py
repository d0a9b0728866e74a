"""The peer: the full model of a column as a method-of-lines script on scipy's LSODA, as one would write it by hand.

Unknowns (J, ln c~) in every cell, the potential eliminated by zero current, the same two-point fluxes and graded grid
as fvswell, banded Jacobian by finite differences inside LSODA. Nothing here imports fvswell.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

R, T = 8.314462618, 298.0
RT = R * T
E, NU, K0, NF0, CF0 = 0.5, 0.3, 1e-3, 0.8, 2e-4
PHI, PHI_EXT, BATH = 0.83, 0.93, 1.5e-4
D_CATION, D_ANION, W = 5e-4, 8e-4, 0.6
K, G = E / 3 / (1 - 2 * NU), E / 2 / (1 + NU)


def _stress(J):
    return K / 2 * (J - 1 / J) + G * (J - J ** (-1 / 3))


def _ions(J, log_c):
    c_F = CF0 * NF0 / (J - 1 + NF0)
    total = np.sqrt(c_F * c_F + 4 * np.exp(2 * log_c))
    return 0.5 * (total + c_F), 0.5 * (total - c_F)


def solve(cells: int, grading: float, pressures, duration: float, rtol: float, times=None):
    """Global strain at ``times`` of each phase (equal durations), and the number of right-hand sides."""
    widths = np.geomspace(1.0, grading, cells)
    widths *= 0.5 / widths.sum()
    distances = np.concatenate([[widths[0] / 2], (widths[1:] + widths[:-1]) / 2])
    bath = np.log(BATH)
    pi_bath = 2 * PHI_EXT * RT * BATH
    J0 = brentq(lambda J: _stress(J) - PHI * RT * sum(_ions(J, bath)) + pi_bath, 0.5, 3.0)

    def rates(_, y, pressure):
        J, log_c = y[0::2], y[1::2]
        c_cation, c_anion = _ions(J, log_c)
        mu = _stress(J) + pressure - PHI * RT * (c_cation + c_anion)
        volumes = J * widths
        length = np.concatenate([[volumes[0] / 2], (volumes[1:] + volumes[:-1]) / 2])
        J_face = length / distances
        log_c_face = np.concatenate([[bath], (log_c[1:] + log_c[:-1]) / 2])
        grad_mu = np.diff(mu, prepend=-pi_bath) / length
        grad_c = np.diff(log_c, prepend=bath) / length
        cation, anion = _ions(J_face, log_c_face)
        n_f = (J_face - 1 + NF0) / J_face
        c_F, total = cation - anion, cation + anion
        a, b = D_CATION * cation - D_ANION * anion, D_CATION * cation + D_ANION * anion
        k_open = K0 / (1 + K0 * W**2 * RT * c_F**2 / (n_f * b))
        q = -k_open * (grad_mu + W * RT * (total - c_F * a / b) * grad_c)
        j = anion * W * (1 + D_ANION * c_F / b) * q - n_f * anion * D_ANION * (1 + a / b) * grad_c
        J_rate = -np.diff(q, append=0.0) / widths
        salt_rate = -np.diff(j, append=0.0) / widths
        fluid = J - 1 + NF0
        share = (c_anion - c_cation) / (fluid * (c_cation + c_anion))
        by_J = c_anion - fluid * c_anion * share
        by_log = fluid * 2 * c_cation * c_anion / (c_cation + c_anion)
        out = np.empty_like(y)
        out[0::2] = J_rate
        out[1::2] = (salt_rate - by_J * J_rate) / by_log
        return out

    y = np.tile([J0, bath], cells).astype(float)
    strains, evaluations = [], 0
    for pressure in pressures:
        run = solve_ivp(
            rates, (0.0, duration), y, method="LSODA", args=(pressure,), lband=3, uband=3, rtol=rtol, atol=rtol * 1e-2,
            t_eval=times,
        )  # fmt: skip
        strains.append(run.y[0::2].T @ widths / (0.5 * J0) - 1.0)
        evaluations += run.nfev
        y = run.y[:, -1]
    return np.concatenate(strains), evaluations


if __name__ == "__main__":
    import time

    for cells in (50, 100):
        for rtol in (1e-4, 1e-6, 1e-8):
            start = time.perf_counter()
            strain, evaluations = solve(cells, 20.0, (0.25, 0.0), 600.0, rtol)
            print(cells, rtol, time.perf_counter() - start, evaluations, strain.min(), strain[-1])

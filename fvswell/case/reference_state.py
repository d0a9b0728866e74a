"""The stress-free solid of a case whose numbers are those of a sample in equilibrium with its first bath."""

from __future__ import annotations

from fvswell.case.schema import CaseTable
from fvswell.physics.models import Model
from fvswell.physics.reference_state import stress_free_tissue
from fvswell.physics.tissue import Array, Tissue

__all__ = ["reference_volume_ratio", "stress_free"]


def stress_free(case: CaseTable, tissue: Tissue, model: Model) -> tuple[Tissue, Array | float]:
    """Tissue as a model sees it, with stress-free numbers, and the volume ratio of the reference state.

    Parameters
    ----------
    case
        What the numbers are of, and the bath.
    tissue
        With the numbers of the reference state, as `TissueProperties.at` gives them.
    model
        Without swelling, the equilibrated sample is the stress-free solid.

    Returns
    -------
    tuple
        The tissue; and J of the reference state in a column, 1.0 where it is the stress-free one, nan where no
        stress-free solid comes to the sample.
    """
    tissue = model.tissue(tissue)
    if case.tissue.reference_state == "stress-free":
        return tissue, 1.0
    return stress_free_tissue(tissue, case.bath.concentration)


def reference_volume_ratio(case: CaseTable, tissue: Tissue, model: Model) -> Array | float:
    """J of the reference state in a column, see `stress_free`."""
    return stress_free(case, tissue, model)[1]

"""What the result of a study holds for every run: name, dimensions, unit and meaning, in one table."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["COORDINATES", "RESULT_NAMES", "STRAIN_CURVES", "STUDY_FIELDS", "StudyField"]


@dataclass(frozen=True)
class StudyField:
    """Metadata of a variable; units as UDUNITS reads them."""

    dimensions: tuple[str, ...]
    units: str
    long_name: str
    cell_methods: str = ""  # points along the first dimension unless stated

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes of the variable in a file."""
        return {
            "units": self.units, "long_name": self.long_name, "location": self.dimensions[0],
            "cell_methods": self.cell_methods or f"{self.dimensions[0]}: point",
        }  # fmt: skip


_RUN, _PHASE, _MODEL = ("run",), ("run", "phase"), ("run", "model", "phase")

STRAIN_CURVES = "strain"

STUDY_FIELDS: dict[str, StudyField] = {
    "r_squared": StudyField(_PHASE, "1", "coefficient of determination of the judged model's strain history"),
    "largest_difference": StudyField(
        _PHASE, "1", "strain of the judged model less that of the reference where they are farthest apart",
    ),
    "time_of_largest_difference": StudyField(
        _PHASE, "s", "time of the largest difference since the phase began",
    ),
    "phase_duration": StudyField(_PHASE, "s", "duration of the phase"),
    "final_strain": StudyField(_MODEL, "1", "global strain at the end of the phase"),
    "equilibrium_strain": StudyField(
        _MODEL, "1", "global strain in equilibrium under the loads that the phase ends with"
    ),
    "initial_height": StudyField(("run", "model"), "mm", "height of the equilibrated sample"),
    "balance_error": StudyField(
        ("run", "model"), "1", "largest mismatch of a balance in a step, relative to what crossed the boundary",
        "run: maximum",
    ),
    STRAIN_CURVES: StudyField((*_MODEL, "sample"), "1", "height over height of the equilibrated sample, less one"),
}  # fmt: skip

COORDINATES: dict[str, StudyField] = {
    "protocol": StudyField(_RUN, "1", "protocol of the run"),
    "design": StudyField(_RUN, "1", "design that the run belongs to"),
    "run_status": StudyField(_RUN, "1", "complete, or why there is no result"),
    "phase": StudyField(("phase",), "1", "name of the phase"),
    "model": StudyField(("model",), "1", "the judged model and the reference"),
    "fraction": StudyField(("sample",), "1", "time since the phase began over the phase's duration"),
}

RESULT_NAMES = frozenset({"run", "sample", *STUDY_FIELDS, *COORDINATES})

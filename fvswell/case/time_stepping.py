"""The tables of a case file that say how time is stepped, and when results are written."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from fvswell.case.tables import Table
from fvswell.case.values import Count, Quantity, Text, Times

__all__ = ["STEPS_PER_PHASE", "BackwardEuler", "Esdirk43", "Output", "TimeStepping"]

STEPS_PER_PHASE = 50  # as Wilson et al. (2005)


class TimeStepping(Table):
    """How time is stepped."""

    default_output: ClassVar[dict[str, Any]]

    relaxation_fraction: Annotated[float, Quantity(above=0.0, below=1.0)] = Field(
        default=0.99,
        description="The relaxation time is over when the global strain has gone this fraction of its way.",
    )

    @property
    def fixed_steps(self) -> int | None:
        """Number of equal steps in a phase; None where the error chooses the steps."""
        return None

    @property
    def samples_per_phase(self) -> int:
        """Number of equally spaced times in a phase at which models are compared: the ends of given steps."""
        return self.fixed_steps or STEPS_PER_PHASE


class BackwardEuler(TimeStepping):
    """Equal steps, first order: the scheme of Wilson et al. (2005)."""

    default_output: ClassVar[dict[str, Any]] = {"every": 1}

    scheme: Literal["backward-euler"] = Field(description="First order, equal steps.")
    steps_per_phase: Annotated[int, Count(1)] = Field(
        default=STEPS_PER_PHASE, description="Number of equal steps in a phase."
    )

    @property
    def fixed_steps(self) -> int:
        """Number of equal steps in a phase."""
        return self.steps_per_phase


class Esdirk43(TimeStepping):
    """Steps chosen by the error, fourth order; results between the ends of steps are as accurate."""

    default_output: ClassVar[dict[str, Any]] = {"per_phase": STEPS_PER_PHASE}

    scheme: Literal["esdirk43"] = Field(
        default="esdirk43",
        description="Fourth order, diagonally implicit Runge-Kutta with an explicit first stage, steps chosen by "
        "the error.",
    )
    tolerance: Annotated[float, Quantity(above=0.0, below=1.0)] = Field(
        default=1e-4,
        description="Largest error of the global strain at any output, about, as a fraction of the largest strain.",
    )
    max_step: Annotated[float | None, Quantity("time", above=0.0)] = Field(
        default=None, description="Longest step; without it only the error limits the steps."
    )


class Output(Table):
    """When results are written. Without any of these, every step is (backward-euler), or per_phase = 50 (esdirk43)."""

    alternatives = ("per_phase", "times", "every")
    needs_alternative = False

    per_phase: Annotated[int | None, Count(1)] = Field(
        default=None,
        description="Write at the ends of this many equal parts of each phase, and more often at first: in the part "
        "that follows a jump or the end of a ramp or table; in each period of a sine 16 times or more.",
    )
    times: Annotated[tuple[float, ...] | None, Times()] = Field(
        default=None, description="Write at these times from the start of the run."
    )
    every: Annotated[int | None, Count(1)] = Field(default=None, description="Write every this many steps.")
    measured: Annotated[str | None, Text()] = Field(
        default=None,
        description="History that the experiment measures and models are compared by, such as global_strain, "
        "piston_pressure or piston_potential. Without it the strain of a sample under loads, and the pressure of a "
        "part whose displacement is given.",
    )

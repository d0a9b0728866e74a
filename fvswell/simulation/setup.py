"""What a run needs of a case: a column or a block, its state, its loads, and how its result is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from fvswell.case.case import Case
from fvswell.numerics.loads import Protocol as Phases
from fvswell.numerics.state import Control, Record, State
from fvswell.physics.models import Model
from fvswell.physics.tissue import Array, Tissue
from fvswell.results.layout import Layout

__all__ = ["Setup", "make_setup"]


class Setup(Protocol):
    """What a run needs of a column or a block."""

    case: Case
    model: Model
    volumes: Array
    scale: Array
    state: State  # of the equilibrated sample
    held: Array | None  # loads that a run before has left, nan where they were found

    @property
    def tissue(self) -> Tissue:
        """Tissue in the cells, as the model sees it."""

    @property
    def initial_volume_ratio(self) -> Array:
        """J of the cells of the equilibrated sample."""

    @property
    def initial_stretch(self) -> float:
        """Mean height of the equilibrated sample over that of the stress-free solid."""

    @property
    def stress_free_height(self) -> float:
        """Mean height of the stress-free solid, mm."""

    @property
    def drainage_length(self) -> float:
        """Farthest way to a bath in the equilibrated sample, mm."""

    def equilibrium_strains(self) -> Array:
        """Global strain in equilibrium under the loads that each phase ends with; nothing where it is not known."""

    @property
    def body(self) -> Any:
        """What is integrated, see `fvswell.numerics.body`."""

    @property
    def march(self) -> Callable[..., None]:
        """The integrator, compiled or not."""

    def protocol(self, durations: Sequence[float], *, times: Sequence[float] | Array | None = None) -> Phases:
        """Protocol with phases of the given durations; ``times`` are outputs instead of the case's own."""

    def measured(self) -> list[int]:
        """What the end of each phase may depend on: index of a load, or `fvswell.numerics.loads.STRAIN`."""

    def largest_strain(self) -> float:
        """Largest strain that is expected."""

    def first_step(self) -> float:
        """Step to start with where loads jump, s."""

    def control(self) -> Control:
        """How the steps are chosen."""

    def strain(self, state: State) -> float:
        """Global strain."""

    def fields(self, record: Record) -> dict[str, Array]:
        """Fields of all outputs of a record."""

    def place(self, balance: str, point: int) -> str:
        """Where a point of a balance lies."""

    def layout(self, durations: Sequence[float]) -> Layout:
        """Layout of the result."""


def make_setup(case: Case, model: Model | None = None, held: Array | None = None) -> Setup:
    """What is integrated for a case, with its own model or another.

    ``held`` are the loads that a run before has left, nan where they were found: what the first phases do not name goes
    on so. Without it the sample is in equilibrium with its bath.
    """
    setup: Setup
    if case.geometry.kind == "column":
        from fvswell.simulation.column_run import ColumnRun

        setup = ColumnRun(case, model, held)
    else:
        from fvswell.simulation.block_run import BlockRun

        setup = BlockRun(case, model, held)
    if case.assembly != "compiled":
        from fvswell.fipy import assembled

        return assembled(setup)
    return setup

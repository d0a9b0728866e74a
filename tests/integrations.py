"""Columns run by the time integrator itself: no case, no file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tissues import BATH, reference_tissue

from fvswell.boundary.parts import Part
from fvswell.column.balances import COLUMN_LOADS
from fvswell.column.column import Column, compiled_march
from fvswell.column.grid import column_grid
from fvswell.column.stage import ColumnBody
from fvswell.numerics.loads import AnyLoad, Load, Protocol, make_protocol
from fvswell.numerics.state import COMPLETE, STATUS, Control, Record, State, Workspace, record_room, workspace
from fvswell.numerics.tableaux import BACKWARD_EULER, ESDIRK43, Tableau
from fvswell.physics.models import MODELS
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue

HEIGHT = 0.5


def make_column(
    model: str = "electrochemical", tissue: Tissue | None = None, cells: int = 20, grading: float = 20.0,
    height: float = HEIGHT, concentration: float = BATH, **options: Any,
) -> Column:  # fmt: skip
    """A column of one tissue in its bath."""
    own = MODELS[model].tissue(tissue or reference_tissue())
    return Column(column_grid(height, cells, grading), MODELS[model], own, own, concentration, **options)


def parts_with(
    open_ends: tuple[bool, bool] = (True, False), electrical: tuple[Any, Any] = ("grounded", ""),
    electrode: tuple[Any, Any] = ("bath", "bath"),
) -> tuple[Part, Part]:  # fmt: skip
    """Filter and piston; by default the piston floats if it is open, and is an insulator if it is closed."""
    chosen = electrical[0], electrical[1] or ("floating" if open_ends[1] else "insulating")
    filter_part, piston = (
        Part(name, mechanical, opened, condition, kind)
        for name, mechanical, opened, condition, kind in zip(
            ("filter", "piston"), ("fixed", "straight"), open_ends, chosen, electrode, strict=True
        )
    )
    return filter_part, piston


def loads(
    pressure: AnyLoad | float | None = 0.0, bath: AnyLoad | float = BATH, height: AnyLoad | float | None = None,
    **others: Any,
) -> list[AnyLoad | None]:  # fmt: skip
    """Loads of one phase; a number is a load that is there at once. With a height, the pressure is found."""
    assert others.keys() <= set(COLUMN_LOADS)
    chosen: dict[str, Any] = dict.fromkeys(COLUMN_LOADS)
    chosen |= {"pressure": pressure if height is None else None, "height": height, "filter_current": 0.0}
    chosen |= {f"{end}_bath_{kind}": value for end in ("filter", "piston")
               for kind, value in (("concentration", bath), ("pressure", 0.0))} | others  # fmt: skip
    return [Load(load) if isinstance(load, float | int) else load for load in map(chosen.__getitem__, COLUMN_LOADS)]


def first_step(column: Column) -> float:
    """A hundredth of the time of diffusion through the smallest cell, s."""
    tissue = column.cells
    modulus = np.max(aggregate_modulus(tissue.solid, tissue.fluid_fraction))
    permeability = np.max(tissue.permeability.hydraulic_permeability)
    return float(0.1 * column.grid.widths.min() ** 2 / (permeability * modulus))


def make_control(scheme: Tableau = ESDIRK43, tolerance: float = 1e-4, **settings: Any) -> Control:
    """Settings of the integrator: those of the error-controlled scheme, or of equal steps."""
    usual = scheme._asdict() | {
        "tolerance": tolerance, "expected_strain": 1e-3, "max_step": np.inf, "first_step": 1e-3, "fixed_steps": 0,
        "every": 0,
    }  # fmt: skip
    return Control(**(usual | settings))


def equal_steps(steps: int, tolerance: float = 1e-12) -> Control:
    """Backward Euler with equal steps in each phase, every step recorded."""
    return make_control(BACKWARD_EULER, tolerance, fixed_steps=steps, every=1)


@dataclass(frozen=True)
class Integration:
    """A run of a column: where it stands and what it has recorded."""

    column: Column
    volume_ratio: Array  # at the start
    body: ColumnBody
    protocol: Protocol
    control: Control
    state: State
    record: Record
    work: Workspace

    @classmethod
    def of(
        cls, column: Column, protocol: Protocol, control: Control, outputs: int = 3000, steps: int = 20_000
    ) -> Integration:
        """A run that has not begun."""
        J = column.initial_volume_ratio()
        state = column.start(J)
        return cls(
            column, J, column.body(J), protocol, control, state, record_room(state, outputs, steps),
            workspace(state, len(control.nodes)),
        )  # fmt: skip

    def go_on(self) -> Integration:
        """Run until the protocol is over, the run fails or the record is full."""
        scale = self.column.scale[: len(self.state.contents)]
        compiled_march(
            self.body, self.column.grid.widths, scale, self.protocol, self.control, self.state, self.record, self.work
        )
        return self

    def with_room(self, outputs: int, steps: int) -> Integration:
        """The same run with an empty record."""
        return replace(self, record=record_room(self.state, outputs, steps))

    def copy(self) -> Integration:
        """An independent copy of the run, with a body and workspace of its own."""

        def copied(arrays: Any) -> Any:
            return type(arrays)(*(a.copy() if isinstance(a, np.ndarray) else a for a in arrays))

        return replace(
            self, body=self.column.body(self.volume_ratio), protocol=copied(self.protocol), state=copied(self.state),
            record=copied(self.record), work=workspace(self.state, len(self.control.nodes)),
        )  # fmt: skip

    @property
    def complete(self) -> bool:
        """Whether the protocol is over."""
        return bool(self.state.counts[STATUS] == COMPLETE)

    def filled(self, name: str) -> Array:
        """What has been recorded of one of the arrays of the record."""
        count = self.record.filled[1 if name == "steps" else 0]
        values: Array = getattr(self.record, name)[:count]
        return values

    @property
    def time(self) -> Array:
        """Times of the outputs, s."""
        return self.filled("time")

    @property
    def height(self) -> Array:
        """Heights of the column at the outputs, mm."""
        value: Array = self.filled("contents")[:, 0] @ self.column.grid.widths
        return value

    @property
    def strain(self) -> Array:
        """Global strain at the outputs."""
        return self.height / (self.volume_ratio @ self.column.grid.widths) - 1.0

    @property
    def iterations(self) -> int:
        """Newton iterations of all steps."""
        return int(self.filled("steps")[:, 2].sum())


def integrate(column: Column, protocol: Protocol, control: Control, **room: int) -> Integration:
    """Run a column to the end of its protocol."""
    return Integration.of(column, protocol, control, **room).go_on()


def compression(pressure: float = 0.25, duration: float = 600.0, output_times: Any = ()) -> Protocol:
    """The reference compression: loading and unloading."""
    return make_protocol([loads(pressure), loads(0.0)], [duration, duration], output_times)


def swelling(bath: float = 1e-4, duration: float = 600.0, output_times: Any = ()) -> Protocol:
    """The reference free swelling: a weaker bath and back."""
    return make_protocol([loads(bath=bath), loads(bath=BATH)], [duration, duration], output_times)

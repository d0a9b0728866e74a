"""From cases to columns: N cases on one grid become N rows of one system, ready to march."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fvswell.case.case import Case
from fvswell.case.values import Ramp, final_value
from fvswell.column.column import Column
from fvswell.column.grid import ColumnGrid, column_grid
from fvswell.column.newton import ColumnSystem
from fvswell.column.stock_terms import StockTermsTransport
from fvswell.column.transport_term import CoupledTransportTerm
from fvswell.numerics.conservation import ConservationBooks
from fvswell.numerics.protocol import Drive, Protocol, phase_targets
from fvswell.numerics.time_stepping import BACKWARD_EULER, FIRST_STEP, SDIRK2, SMALLEST_STRAIN, State, StepControl
from fvswell.physics.electrochemistry import ion_concentrations
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS, Mixture, Model
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.solid import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue

__all__ = ["ColumnBatch"]


@dataclass(frozen=True)
class ColumnBatch:
    """Columns that differ in tissue, bath and protocol, but share grid, model, phases and time scheme."""

    cases: Sequence[Case]
    grid: ColumnGrid
    cells: Mixture
    system: ColumnSystem
    initial_volume_ratio: Array  # (rows, cells): equilibrated with the first bath, no load

    @classmethod
    def of(cls, cases: Sequence[Case], model: Model | None = None) -> ColumnBatch:
        """Columns of cases that differ in values only; ``model`` replaces the cases' own."""
        first = cases[0]
        model = model or MODELS[first.model]
        grid = column_grid(first.geometry.height, first.geometry.cells, first.geometry.grading)
        concentration = np.array([[case.bath.concentration] for case in cases])
        bath_coefficient = np.array([[case.bath.osmotic_coefficient] for case in cases])
        cells = Mixture(model, _stacked([case.tissue_at(grid.centres) for case in cases]), bath_coefficient)
        faces = Mixture(model, _stacked([case.tissue_at(grid.nodes[:-1]) for case in cases]), bath_coefficient)
        J = equilibrium_volume_ratio(cells.tissue, 0.0, concentration, bath_coefficient, model.swelling)
        J = np.broadcast_to(J, (len(cases), len(grid.widths))).copy()
        if model.open_circuit and first.open_circuit_permeability != "state":
            fixed = first.open_circuit_permeability == "initial"
            stretch = grid.face_stretch(J)
            ions = ion_concentrations(faces.tissue, stretch, np.log(concentration))
            ratio = open_circuit_ratio(faces.tissue, stretch, *ions)
            faces = replace(faces, open_circuit_ratio=ratio if fixed else np.ones((1, 1)))
        transport = StockTermsTransport if first.assembly == "stock-terms" else CoupledTransportTerm
        return cls(cases, grid, cells, ColumnSystem(transport(grid, Column(cells, faces))), J)

    @property
    def model(self) -> Model:
        """Model of all rows."""
        return self.cells.model

    @property
    def initial_height(self) -> Array:
        """Height of the equilibrated columns, (rows,), mm."""
        return self.initial_volume_ratio @ self.grid.widths

    def start(self) -> State:
        """State of the equilibrated columns."""
        rows, cells = self.initial_volume_ratio.shape
        bath = np.array([case.bath.concentration for case in self.cases])
        unknowns = np.zeros((len(self.model.balances), rows, cells))
        unknowns[0] = self.initial_volume_ratio
        if self.model.transports_ions:
            unknowns[1] = np.log(bath)[:, None]
        log_concentration = np.broadcast_to(np.log(bath)[:, None], (rows, cells))
        return State(
            unknowns=unknowns,
            loads={"pressure": np.zeros(rows), "height": self.initial_height, "bath": bath},
            contents=self.cells.contents(self.cells.at(unknowns[0], log_concentration)).copy(),
            fluxes=np.zeros((*unknowns.shape[:2], cells + 1)),
            phase=np.zeros(rows, dtype=int), time=np.zeros(rows), elapsed=np.zeros(rows),
        )  # fmt: skip

    def books(self, state: State) -> ConservationBooks:
        """Books on the balances, from a state on."""
        cations = self._cation_contents if self.model.transports_ions else None
        return ConservationBooks(self.grid.widths, self.model.balances, state, cations)

    def _cation_contents(self, unknowns: Array) -> Array:
        """Cations per reference volume, (rows, cells)."""
        return self.cells.cation_contents(unknowns[0], unknowns[1])

    def drives(self) -> dict[str, Drive]:
        """Driven quantities over the phases; the bath keeps its value where a phase does not name it."""
        shape = (len(self.cases), len(self.cases[0].phase))
        target = {name: np.full(shape, np.nan) for name in ("pressure", "height", "bath")}
        over = {name: np.zeros(shape) for name in target}
        for row, case in enumerate(self.cases):
            bath: float = case.bath.concentration
            for p, phase in enumerate(case.phase):
                loads = {"bath": phase.bath_concentration, "pressure": phase.piston_pressure,
                         "height": phase.piston_displacement}  # fmt: skip
                for name, load in loads.items():
                    if load is not None:
                        target[name][row, p] = final_value(load)
                        over[name][row, p] = load.over if isinstance(load, Ramp) else 0.0
                bath = bath if np.isnan(target["bath"][row, p]) else target["bath"][row, p]
                target["bath"][row, p] = bath
        target["height"] += self.initial_height[:, None]
        return {name: Drive(target[name], over[name]) for name in target}

    def protocol(self, duration: Array) -> Protocol:
        """Protocol with phases of the given durations, ``(rows, phases)``, s."""
        drives, case = self.drives(), self.cases[0]
        targets = phase_targets(duration, drives.values(), case.time.fixed_steps, case.output.times or ())
        return Protocol(duration, drives, targets)

    def control(self) -> StepControl:
        """How the steps are chosen."""
        time = self.cases[0].time
        if time.fixed_steps is not None:
            return StepControl(BACKWARD_EULER)
        return self.error_control(time.tolerance, time.max_step or np.inf)

    def error_control(self, tolerance: float, max_step: float = np.inf) -> StepControl:
        """SDIRK2 with steps chosen by the error; ``tolerance`` is relative to the largest equilibrium strain."""
        stiffness = self.cells.tissue.hydraulic_permeability * aggregate_modulus(self.cells.tissue)
        first = FIRST_STEP * float(self.grid.widths.min()) ** 2 / stiffness.max(axis=1)
        return StepControl(SDIRK2, tolerance * self.largest_strain(), max_step, first)

    def consolidation_time(self) -> Array:
        """h^2/(k H) of the equilibrated columns, H being the aggregate modulus at J = 1, (rows,), s."""
        tissue = self.cells.tissue
        slowest = (tissue.hydraulic_permeability * aggregate_modulus(tissue)).min(axis=1)
        return self.initial_height**2 / slowest

    def equilibrium_heights(self) -> Array:
        """Height at rest under the loads that each phase ends with, ``(rows, phases)``, mm."""
        held = self.drives()["height"].target
        return np.where(np.isnan(held), self._free_heights(), held)

    def largest_strain(self) -> Array:
        """Largest equilibrium strain of the protocol, ``(rows,)``.

        Where the piston's position is prescribed, also that of the sample let free: a bath moves a held sample inside.
        """
        heights = np.stack([self.equilibrium_heights(), self._free_heights()], axis=1)
        strain = np.abs(heights / self.initial_height[:, None, None] - 1.0)
        return np.fmax(np.nan_to_num(strain).max(axis=(1, 2)), SMALLEST_STRAIN)

    def _free_heights(self) -> Array:
        """As `equilibrium_heights`, pistons that are held let go; nan where that leaves no water."""
        drives, free = self.drives(), []
        for pressure, bath in zip(drives["pressure"].target.T, drives["bath"].target.T, strict=True):
            J = equilibrium_volume_ratio(
                self.cells.tissue, np.nan_to_num(pressure)[:, None], bath[:, None],
                self.cells.bath_osmotic_coefficient, self.model.swelling,
            )  # fmt: skip
            free.append(np.broadcast_to(J, self.initial_volume_ratio.shape) @ self.grid.widths)
        return np.stack(free, axis=1)


def _stacked(tissues: Sequence[Tissue]) -> Tissue:
    """One tissue with a row for each; a property that is the same in all keeps a single row."""

    def stack(name: str) -> Array:
        values = [getattr(tissue, name) for tissue in tissues]
        if all(value is values[0] or np.array_equal(value, values[0]) for value in values):
            return values[0]
        return np.concatenate(np.broadcast_arrays(*values), axis=0)

    arrays = {field.name: stack(field.name) for field in fields(Tissue) if field.name != "solid"}
    return Tissue(solid=tissues[0].solid, **arrays)

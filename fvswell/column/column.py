"""A column of one tissue with one model: its grid, its laws in compiled form, and the state it starts from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fvswell.boundary.parts import Part
from fvswell.column.balances import COLUMN_LOADS, DIMENSIONS, full_balances, reduced_balances
from fvswell.column.electrical import Parts, current_is_found, electrode_sign
from fvswell.column.grid import ColumnGrid
from fvswell.column.stage import ColumnBody
from fvswell.compiled import kernel, law_kernel
from fvswell.numerics.integrator import march
from fvswell.numerics.state import State, start_state
from fvswell.physics import permeability
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import Model
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, tissue_parameters

__all__ = ["FILTER_AND_PISTON", "Column", "OpenCircuit", "compiled_march"]

OpenCircuit = Literal["initial", "state", "none"]
FILTER_AND_PISTON: Parts = (
    Part("filter", "fixed", open=True, electrical="grounded"), Part("piston", "straight")
)  # fmt: skip
compiled_march = kernel(march)


@dataclass(frozen=True)
class Column:
    """A column between a filter at x = 0, which is fixed, and a piston.

    Parameters
    ----------
    grid
        Reference geometry.
    model
        What is transported.
    cells, faces
        Tissue at the cells (cells,) and at all faces (cells + 1,), or of one point for all.
    concentration
        Of the bath that the column is equilibrated in, mmol/mm3.
    open_circuit
        Permeability of a model that has the streaming potential in it: with k_open/k of the initial state, or of the
        state as it is, or the tissue's own.
    parts
        The filter at x = 0 and the piston at x = h: their names, baths and electrical conditions. That the filter is
        open to the bath, and the piston closed and an insulator, is the default.

    Raises
    ------
    ValueError
        If a closed part conducts and has no electrode.
    """

    grid: ColumnGrid
    model: Model
    cells: Tissue
    faces: Tissue
    concentration: float
    open_circuit: OpenCircuit = "initial"
    parts: Parts = FILTER_AND_PISTON

    def __post_init__(self) -> None:
        for part in self.parts:
            if not part.open and part.electrical != "insulating" and electrode_sign(part) == 0.0:
                raise ValueError(
                    f"{part.name}: a closed part that conducts needs an electrode, for cations or for anions"
                )

    def initial_volume_ratio(self) -> Array:
        """J of the cells in equilibrium with the bath under no load, (cells,); nan where there is no equilibrium."""
        return np.broadcast_to(
            equilibrium_volume_ratio(self.cells, 0.0, self.concentration), len(self.grid.widths)
        ).copy()

    def contents(self, J: Array, concentration: float) -> Array:
        """Contents (balances, cells) of cells in equilibrium with a bath."""
        if not self.model.transports_ions:
            return J[None].copy()
        log_activity = bath_log_activity(self.cells.osmotic, np.asarray(concentration))
        _, anion = ion_concentrations(self.cells.osmotic, fixed_charge_density(self.cells, J), log_activity)
        return np.stack([J, (J - 1.0 + self.cells.fluid_fraction) * anion])

    def start(self, J: Array) -> State:
        """State of the equilibrated column; ``J`` as `initial_volume_ratio` gives it."""
        contents = self.contents(J, self.concentration)
        loads = np.zeros(len(COLUMN_LOADS))
        loads[COLUMN_LOADS.index("height")] = J @ self.grid.widths
        loads[COLUMN_LOADS.index("filter_bath_concentration")] = self.concentration
        loads[COLUMN_LOADS.index("piston_bath_concentration")] = self.concentration
        return start_state(np.append(contents.ravel(), [0.0, 0.0]), contents, loads, parts=2)

    def body(self, J: Array) -> ColumnBody:
        """The column as compiled code takes it; ``J`` is the initial volume ratio."""
        n, unknowns = len(self.grid.widths), 2 if self.model.transports_ions else 1
        rows = 3 if self.current_is_found else unknowns
        laws = (type(self.cells.solid), type(self.cells.permeability), type(self.cells.osmotic))
        if self.model.transports_ions:
            evaluate = law_kernel(full_balances, DIMENSIONS, *laws, self.current_is_found)
        else:
            of_state = self.model.open_circuit and self.open_circuit == "state"
            evaluate = law_kernel(reduced_balances, DIMENSIONS, *laws, of_state)
        faces = np.vstack([tissue_parameters(self.faces, n + 1), self.open_circuit_ratio(J)])

        def blocks(count: int, rows: int = unknowns) -> Any:
            return np.zeros((rows, unknowns, count))

        return ColumnBody(
            evaluate=evaluate, cells=tissue_parameters(self.cells, n), faces=faces, metric=self.grid.metric,
            ends=self.ends, widths=self.grid.widths, scale=self.scale[:unknowns],
            dry=np.broadcast_to(1.0 - np.asarray(self.cells.fluid_fraction, dtype=float), n).copy(),
            initial_height=float(J @ self.grid.widths), fluxes=np.zeros((4, n + 1)), by_lower=blocks(n + 1, rows),
            by_upper=blocks(n + 1, rows), by_pressure=np.zeros((rows, 2)), by_current=np.zeros((rows, n + 1)),
            potentials=np.zeros((6, n)), lower=blocks(n), diagonal=blocks(n), upper=blocks(n),
            right=np.zeros((unknowns, n)), step=np.zeros((unknowns, n)), response=np.zeros((unknowns, n)),
            electric=np.zeros((unknowns, n)),
            start=np.zeros((unknowns, n + 1)),
        )  # fmt: skip

    @property
    def current_is_found(self) -> bool:
        """Whether the current follows from the potentials of both parts."""
        return self.model.transports_ions and current_is_found(self.parts)

    @property
    def ends(self) -> Array:
        """For both parts, whether they are open, and the sign of the ion that an electrode exchanges; (2, 2)."""
        return np.array([[float(part.open) for part in self.parts], [electrode_sign(part) for part in self.parts]])

    @property
    def scale(self) -> Array:
        """Natural size of the contents: 1 for J, the bath's concentration for anions."""
        return np.array([1.0, self.concentration])

    def open_circuit_ratio(self, J: Array) -> Array:
        """k_open/k at the faces (cells + 1,) where a model holds it constant, else 1."""
        if not self.model.open_circuit or self.open_circuit != "initial":
            return np.ones(len(self.grid.widths) + 1)
        stretch = self.grid.face_stretch(J)
        log_activity = bath_log_activity(self.faces.osmotic, np.asarray(self.concentration))
        ions = ion_concentrations(self.faces.osmotic, fixed_charge_density(self.faces, stretch), log_activity)
        return np.broadcast_to(permeability.open_circuit_ratio(self.faces, stretch, *ions), stretch.shape)

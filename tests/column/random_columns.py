"""Random columns and protocols, drawn from a seed."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from integrations import HEIGHT, loads, make_column
from tissues import point_of, random_tissue

from fvswell.column.column import Column
from fvswell.numerics.loads import Load
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.solids import SOLIDS, aggregate_modulus
from fvswell.physics.tissue import Array

KINDS = ("load", "bath", "load and back", "bath and back", "held, bath", "moved", "load and bath", "ramp and back")
SMALLEST_STRAIN = 1e-3  # that the tolerance is relative to where nothing is expected to happen


class RandomRun(NamedTuple):
    """A column and what is done to it."""

    kind: str
    column: Column
    phases: list[list[Load | None]]
    durations: list[float]

    @property
    def initial(self) -> Array:
        """J of the equilibrated column."""
        return self.column.initial_volume_ratio()

    def expected_strain(self) -> float:
        """Largest strain of the equilibria that the protocol goes to, of the sample let free where it is held."""
        strains = [SMALLEST_STRAIN]
        for pressure, height, bath, *_ in self.phases:
            J = equilibrium_volume_ratio(self.column.cells, pressure.target if pressure else 0.0, bath.target)  # type: ignore[union-attr]
            strains.append(abs(float(np.mean(J) / np.mean(self.initial)) - 1.0))
            if height:
                strains.append(abs(height.target / self.height - 1.0))
        return float(np.nanmax(strains))

    @property
    def height(self) -> float:
        """Of the equilibrated column, mm."""
        return float(self.initial @ self.column.grid.widths)


def random_run(seed: int, cells: int = 50, solids: tuple[str, ...] = ("neo-hookean",)) -> RandomRun:
    """One of each kind in turn; three in four with the full model, the others with biphasic swelling."""
    draw, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    solid = solids[int(draw.integers(len(solids)))]
    tissue = point_of(random_tissue(1, seed + 1000, solid, permeability_exponent=0.0), 0)
    before, after = np.exp(draw.uniform(np.log(5e-5), np.log(3e-4), 2))
    pressure = float(draw.uniform(0.05, 0.3))
    model = ("electrochemical", "electrochemical", "electrochemical", "biphasic-swelling")[draw.integers(4)]
    column = make_column(model, tissue, cells, 20.0, HEIGHT, float(before))
    mobility = aggregate_modulus(tissue.solid, tissue.fluid_fraction) * tissue.permeability.hydraulic_permeability
    slowness = HEIGHT**2 / float(mobility)
    time = float(slowness * np.exp(draw.uniform(np.log(0.3), np.log(3.0))))
    height = float(column.initial_volume_ratio() @ column.grid.widths)
    moved = height * (1.0 - float(draw.uniform(0.02, 0.1)))
    phases, durations = {
        "load": ([loads(pressure, before)], [time]),
        "bath": ([loads(0.0, after)], [time]),
        "load and back": ([loads(pressure, before), loads(0.0, before)], [time, 3 * time]),
        "bath and back": ([loads(0.0, after), loads(0.0, before)], [time, 3 * time]),
        "held, bath": ([loads(height=height, bath=after)], [time]),
        "moved": ([loads(height=Load(moved, 0.1 * time), bath=before)], [time]),
        "load and bath": ([loads(pressure, after), loads(0.5 * pressure, before)], [time, time]),
        "ramp and back": (
            [loads(Load(pressure, 0.3 * time), before), loads(Load(0.0, 0.3 * time), before)], [time, time],
        ),
    }[kind]  # fmt: skip
    return RandomRun(kind, column, phases, durations)


def wild_run(seed: int) -> RandomRun:
    """Columns and protocols from wider ranges: few or many cells, any model and solid, one to three phases."""
    draw = np.random.default_rng(seed)

    def decades(low: float, high: float) -> float:
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    solid, model = str(draw.choice(list(SOLIDS))), str(draw.choice(list(MODELS)))
    cells = int(draw.integers(3, 40))
    varying = cells if draw.random() < 0.3 else 1
    tissue = random_tissue(
        varying, seed + 5000, solid, youngs_modulus=np.array([decades(0.1, 1.0) for _ in range(varying)]),
        stiffening_coefficient=draw.uniform(0.1, 1.5), permeability_exponent=draw.uniform(0.0, 4.0),
        fluid_fraction=draw.uniform(0.65, 0.9), fixed_charge_density=draw.uniform(0.0, 4e-4),
        osmotic_coefficient=draw.uniform(0.7, 1.0),
    )  # fmt: skip
    bath = decades(5e-5, 3e-4)
    uniform = make_column(
        model, point_of(tissue, varying // 2), cells, decades(1.0, 30.0), concentration=bath,
        open_circuit=str(draw.choice(["initial", "state", "none"])),
    )  # fmt: skip
    column = replace(uniform, cells=MODELS[model].tissue(tissue)) if varying > 1 else uniform
    height = float(column.initial_volume_ratio() @ column.grid.widths)
    phases, durations = [], []
    for _ in range(int(draw.integers(1, 4))):
        duration = decades(5.0, 3e3)
        over = float(duration * draw.uniform(0.2, 1.0))
        if draw.random() < 0.5:
            bath = decades(5e-5, 3e-4)
        salt = Load(bath, over if draw.random() < 0.5 else 0.0)
        if draw.random() < 0.25:
            phases.append(loads(height=Load(height * (1.0 + float(draw.uniform(-0.25, 0.05))), over), bath=salt))
        else:
            phases.append(loads(Load(float(draw.uniform(0.0, 0.6)), over if draw.random() < 0.5 else 0.0), salt))
        durations.append(duration)
    return RandomRun("wild", column, phases, durations)

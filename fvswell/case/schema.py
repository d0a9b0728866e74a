"""The tables and keys of a case file: what each means, its dimension, default and allowed range.

The descriptions here are the only place where the meaning of a key is told; the reference in the
documentation is written from them. All values are in internal units.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator

from fvswell.case.profiles import Coordinates, DepthProfile, PlaneProfile, Profile
from fvswell.case.values import Choice, Count, Duration, Load, Name, Quantity, Ramp, RelaxationTimes, Text, Times
from fvswell.physics.solid import SOLIDS
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "BLOCK_GEOMETRIES",
    "GEOMETRIES",
    "LARGEST_GRADING",
    "MODELS",
    "STEPS_PER_PHASE",
    "BackwardEuler",
    "Bath",
    "CaseTable",
    "ColumnGeometry",
    "ColumnPhase",
    "ErrorControlledSdirk2",
    "Output",
    "Phase",
    "Table",
    "TimeStepping",
    "TissueProperties",
    "inner_tables",
    "is_array",
    "variant",
    "variant_names",
]

MODELS = ("biphasic", "biphasic-swelling", "electrochemical")
BLOCK_GEOMETRIES = ("plane-strain", "axisymmetric")
GEOMETRIES = ("column", *BLOCK_GEOMETRIES)
LARGEST_GRADING = 1e6
STEPS_PER_PHASE = 50  # as Wilson et al. (2005)

_Varying = float | DepthProfile | PlaneProfile
_DIFFUSIVITY = Quantity("diffusivity", above=0.0, varying=True)


class Table(BaseModel):
    """A table of a case file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    alternatives: ClassVar[tuple[str, ...]] = ()  # keys of which at most one may be given
    needs_alternative: ClassVar[bool] = True  # and exactly one has to be

    @classmethod
    def presence_problems(cls, table: Mapping[str, Any]) -> list[tuple[str, str]]:
        """Keys of a raw table that exclude each other or are missing, each with what is allowed."""
        given = [key for key in cls.alternatives if key in table]
        if len(given) > 1:
            return [(given[1], f"cannot stand beside {given[0]}: give one of {', '.join(cls.alternatives)}")]
        if cls.alternatives and cls.needs_alternative and not given:
            return [(cls.alternatives[0], f"missing; give one of {', '.join(cls.alternatives)}")]
        return []


class ColumnGeometry(Table):
    """A column between a filter (bottom) and a piston (top), deforming along its axis only."""

    kind: Annotated[str, Choice(GEOMETRIES)] = Field(
        description="column: under a piston, on a filter open to the bath. The others are blocks, see below."
    )
    height: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Height of the stress-free solid (J = 1)."
    )
    cells: Annotated[int, Count(2, 10_000)] = Field(default=50, description="Number of cells over the height.")
    grading: Annotated[float, Quantity(at_least=1.0, at_most=LARGEST_GRADING)] = Field(
        default=1.0, description="Largest cell over smallest; the finest lies at the filter."
    )


class Bath(Table):
    """The bath that the sample is equilibrated in before the first phase."""

    concentration: Annotated[float, Quantity("concentration", above=0.0)] = Field(
        description="Concentration of the monovalent salt before the first phase."
    )
    osmotic_coefficient: Annotated[float, Quantity(above=0.0)] = Field(
        description="Osmotic coefficient of the bath, phi_ext."
    )
    temperature: Annotated[float, Quantity("temperature", above=0.0)] = Field(
        default=298.0, description="Absolute temperature of bath and tissue."
    )


class TissueProperties(Table):
    """Properties of the tissue; those with an initial value are of the stress-free solid, J = 1."""

    alternatives = ("osmotic_coefficient", "osmotic_coefficient_per_charge")

    solid: Annotated[str, Choice(SOLIDS)] = Field(
        description="Constitutive law of the solid: that of Wilson et al. (2005), eq 10; that of Bonet and "
        "Wood with the logarithm of J; or that of Holmes and Mow with exponential stiffening."
    )
    youngs_modulus: Annotated[_Varying, Quantity("pressure", above=0.0, varying=True)] = Field(
        description="Young's modulus of the drained solid at small strain, E."
    )
    poisson_ratio: Annotated[_Varying, Quantity(above=-1.0, below=0.5, varying=True)] = Field(
        description="Poisson's ratio of the drained solid at small strain, nu."
    )
    stiffening_coefficient: Annotated[_Varying | None, Quantity(above=0.0, varying=True)] = Field(
        default=None, description="beta of the Holmes-Mow law, which needs it; other laws do not take it."
    )
    hydraulic_permeability: Annotated[_Varying, Quantity("hydraulic permeability", above=0.0, varying=True)] = Field(
        description="Permeability at J = 1, k0."
    )
    permeability_exponent: Annotated[_Varying, Quantity(varying=True)] = Field(
        default=0.0, description="M in k = k0 exp(M (J - 1))."
    )
    fluid_fraction: Annotated[_Varying, Quantity(above=0.0, below=1.0, varying=True)] = Field(
        description="Volume fraction of the fluid at J = 1, n_f0."
    )
    fixed_charge_density: Annotated[_Varying, Quantity("concentration", at_least=0.0, varying=True)] = Field(
        description="Fixed negative charge per volume of fluid at J = 1, c_F0 (one equivalent is one mole)."
    )
    osmotic_coefficient: Annotated[_Varying | None, Quantity(above=0.0, varying=True)] = Field(
        default=None, description="Osmotic coefficient inside the tissue, phi_int. Either this or the next."
    )
    osmotic_coefficient_per_charge: Annotated[_Varying | None, Quantity("volume per charge", varying=True)] = Field(
        default=None,
        description="X in phi_int = phi_ext - X c_F0, Wilson et al. (2005), eq 14; phi_int must be above 0.",
    )
    activity_ratio: Annotated[_Varying, Quantity(above=0.0, varying=True)] = Field(
        default=1.0, description="Square of the ratio of the activity coefficients outside and inside."
    )
    cation_diffusivity: Annotated[_Varying, _DIFFUSIVITY] = Field(description="Diffusivity of the cation, D+.")
    anion_diffusivity: Annotated[_Varying, _DIFFUSIVITY] = Field(description="Diffusivity of the anion, D-.")
    hindrance_factor: Annotated[_Varying, Quantity(at_least=0.0, at_most=1.0, varying=True)] = Field(
        default=0.0, description="r: the water drags the ions along with 1 - r of its velocity."
    )

    @classmethod
    def presence_problems(cls, table: Mapping[str, Any]) -> list[tuple[str, str]]:
        """As for every table; and the stiffening coefficient goes with the law that uses it."""
        problems = super().presence_problems(table)
        key, solid, given = "stiffening_coefficient", table.get("solid"), "stiffening_coefficient" in table
        if solid == "holmes-mow" and not given:
            problems.append((key, 'missing; solid = "holmes-mow" needs it'))
        if solid in SOLIDS and solid != "holmes-mow" and given:
            problems.append((key, 'is for solid = "holmes-mow" only'))
        return problems

    def at(self, coordinates: Coordinates, bath: Bath) -> Tissue:
        """Tissue at points; arrays of shape (1, 1) where homogeneous, (1, points) where varying."""

        def values(quantity: float | Profile | None) -> Array:
            if isinstance(quantity, Profile):
                return quantity.at(coordinates)[np.newaxis, :]
            return np.array([[np.nan if quantity is None else quantity]])  # None: a law that does not use it

        if self.osmotic_coefficient is None:
            fall = values(self.osmotic_coefficient_per_charge) * values(self.fixed_charge_density)
            osmotic_coefficient = bath.osmotic_coefficient - fall
        else:
            osmotic_coefficient = values(self.osmotic_coefficient)
        computed = {"osmotic_coefficient": osmotic_coefficient, "temperature": values(bath.temperature)}
        names = (field.name for field in fields(Tissue) if field.name != "solid" and field.name not in computed)
        return Tissue(solid=self.solid, **{name: values(getattr(self, name)) for name in names}, **computed)


class Phase(Table):
    """A stretch of time with one set of boundary conditions; what every geometry has."""

    name: Annotated[str, Name()] = Field(description="Name of the phase; no two are alike.")
    duration: Annotated[float | RelaxationTimes, Duration()] = Field(
        description="How long the phase lasts; the relaxation time is that of the biphasic-swelling model in "
        "this phase, see relaxation_fraction."
    )
    bath_concentration: Annotated[float | Ramp | None, Load(Quantity("concentration", above=0.0))] = Field(
        default=None, description="Concentration of the bath; without it, as the previous phase left it."
    )

    @field_validator("*")
    @classmethod
    def _ramp_within_phase(cls, value: Any, info: ValidationInfo) -> Any:
        duration = info.data.get("duration")
        if isinstance(value, Ramp) and isinstance(duration, float) and value.over > duration:
            raise ValueError(value.longer_than(duration))
        return value


class ColumnPhase(Phase):
    """What the piston and the bath do from the end of the previous phase on."""

    alternatives = ("piston_pressure", "piston_displacement")

    piston_pressure: Annotated[float | Ramp | None, Load(Quantity("pressure"))] = Field(
        default=None, description="Pressure of the piston, positive in compression. Either this or the next."
    )
    piston_displacement: Annotated[float | Ramp | None, Load(Quantity("length"))] = Field(
        default=None,
        description="Displacement of the piston from the equilibrated sample, negative in compression. A "
        "jump would need infinite pressure, so a plain value can only hold the piston where the previous "
        "phase left it (at 0 in the first).",
    )


class TimeStepping(Table):
    """How time is stepped."""

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
    """Equal steps, first order."""

    scheme: Literal["backward-euler"] = Field(default="backward-euler", description="First order, equal steps.")
    steps_per_phase: Annotated[int, Count(1)] = Field(
        default=STEPS_PER_PHASE, description="Number of equal steps in a phase."
    )

    @property
    def fixed_steps(self) -> int:
        """Number of equal steps in a phase."""
        return self.steps_per_phase


class ErrorControlledSdirk2(TimeStepping):
    """Steps chosen by the error, second order."""

    scheme: Literal["sdirk2"] = Field(
        description="Second order, diagonally implicit Runge-Kutta, steps chosen by the error."
    )
    tolerance: Annotated[float, Quantity(above=0.0, below=1.0)] = Field(
        default=1e-4, description="Error allowed in a step, as a fraction of the largest strain."
    )
    max_step: Annotated[float | None, Quantity("time", above=0.0)] = Field(
        default=None, description="Longest step; without it only the error limits the steps."
    )


class Output(Table):
    """When results are written."""

    alternatives = ("every", "times")
    needs_alternative = False

    every: Annotated[int | None, Count(1)] = Field(
        default=None,
        description="Write every this many steps; every step if neither this nor times is given.",
    )
    times: Annotated[tuple[float, ...] | None, Times()] = Field(
        default=None,
        description="Write at these times from the start of the run, which steps then hit exactly.",
    )


def _with_default_scheme(table: Any) -> Any:
    return {"scheme": "backward-euler", **table} if isinstance(table, Mapping) else table


def _with_default_frequency(table: Any) -> Any:
    none = isinstance(table, Mapping) and not any(key in table for key in Output.alternatives)
    return {"every": 1, **table} if none else table


class CaseTable(Table):
    """Keys at the top of the file, and the tables."""

    title: Annotated[str, Text()] = Field(description="What is simulated, in a line.")
    model: Annotated[str, Choice(MODELS)] = Field(description="Which of the three models is solved.")
    assembly: Annotated[str, Choice(("coupled-term", "stock-terms"))] = Field(
        default="coupled-term",
        description="How the equations are assembled: by one coupled FiPy term, or by FiPy's stock terms, "
        "which are slow, and readable as a specification.",
    )
    open_circuit_permeability: Annotated[str, Choice(("initial", "state", "none"))] = Field(
        default="initial",
        description="Permeability of the biphasic-swelling model: the open-circuit permeability of the "
        "equilibrated initial state at each point, the same evaluated with the state, or none: the tissue's "
        "own permeability.",
    )
    geometry: ColumnGeometry
    tissue: TissueProperties
    bath: Bath
    phase: tuple[ColumnPhase, ...]
    time: Annotated[
        BackwardEuler | ErrorControlledSdirk2,
        Field(discriminator="scheme"),
        BeforeValidator(_with_default_scheme),
    ] = BackwardEuler()
    output: Annotated[Output, BeforeValidator(_with_default_frequency)] = Output(every=1)

    @field_validator("phase")
    @classmethod
    def _some_phase(cls, phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
        if not phases:
            raise ValueError("must hold at least one [[phase]]")
        return phases


def inner_tables(table: type[Table], key: str) -> list[type[Table]]:
    """Tables that a key of a table stands for: several for variants, none for a value or an unknown key."""
    return _tables_in(table.model_fields[key].annotation) if key in table.model_fields else []


def is_array(table: type[Table], key: str) -> bool:
    """Whether a key of a table stands for an array of tables."""
    return key in table.model_fields and get_origin(table.model_fields[key].annotation) is tuple


def variant_names(tables: Iterable[type[Table]]) -> dict[str, tuple[str, type[Table]]]:
    """Variants of a table by name, each with the key that holds the name; empty where there are none."""
    return {
        get_args(field.annotation)[0]: (key, table)
        for table in tables
        for key, field in table.model_fields.items()
        if get_origin(field.annotation) is Literal
    }


def variant(tables: list[type[Table]], content: Any) -> type[Table] | None:
    """The one of some variants of a table that raw content is told to be, None if it is none of them."""
    if len(tables) == 1:
        return tables[0]
    for name, (key, table) in variant_names(tables).items():
        if isinstance(content, Mapping) and content.get(key, table.model_fields[key].default) == name:
            return table
    return None


def _tables_in(annotation: Any) -> list[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [table for argument in get_args(annotation) for table in _tables_in(argument)]

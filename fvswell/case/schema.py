"""The tables and keys of a case file: what each means, its dimension, default and allowed range.

The descriptions here are the only place where the meaning of a key is given; the reference in the
documentation is written from them. All values are in internal units.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, cached_property
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationInfo, field_validator

from fvswell.boundary.parts import Part
from fvswell.case.boundary import BlockBoundary, Boundary, ColumnBoundary
from fvswell.case.geometry import AnyGeometry, ColumnGeometry, Geometry
from fvswell.case.phases import BlockPhase, ColumnPhase, Phase
from fvswell.case.profiles import Coordinates, DepthProfile, PlaneProfile, Profile
from fvswell.case.tables import Table, inner_tables, variant
from fvswell.case.time_stepping import BackwardEuler, Esdirk43, Output, TimeStepping
from fvswell.case.values import Choice, Quantity, Text
from fvswell.physics.constants import GAS_CONSTANT
from fvswell.physics.models import MODELS as _MODELS
from fvswell.physics.osmotic import ConstantCoefficients
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.solids import SOLIDS
from fvswell.physics.tissue import Array, Tissue

__all__ = ["MODELS", "Bath", "CaseTable", "TissueProperties"]

MODELS = tuple(_MODELS)

_Varying = float | DepthProfile | PlaneProfile
_LAWS: dict[str, dict[str, Any]] = {"solid": SOLIDS, "permeability": PERMEABILITIES}  # chosen by these keys
_DIFFUSIVITY = Quantity("diffusivity", above=0.0, varying=True)


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

    solid: Annotated[str, Choice(tuple(SOLIDS))] = Field(
        description="Constitutive law of the solid: that of Wilson et al. (2005), eq 10; that of Bonet and "
        "Wood with the logarithm of J; that of Holmes and Mow with exponential stiffening; or that of Wilson et al. "
        "(2007), whose Poisson's ratio follows the solid fraction."
    )
    youngs_modulus: Annotated[_Varying | None, Quantity("pressure", above=0.0, varying=True)] = Field(
        default=None, description="Young's modulus of the drained solid at small strain, E."
    )
    poisson_ratio: Annotated[_Varying | None, Quantity(above=-1.0, below=0.5, varying=True)] = Field(
        default=None, description="Poisson's ratio of the drained solid at small strain, nu."
    )
    shear_modulus: Annotated[_Varying | None, Quantity("pressure", above=0.0, varying=True)] = Field(
        default=None, description="Shear modulus G of the law that takes Poisson's ratio from the solid fraction."
    )
    stiffening_coefficient: Annotated[_Varying | None, Quantity(above=0.0, varying=True)] = Field(
        default=None, description="beta of the Holmes-Mow law, which needs it; other laws do not take it."
    )
    permeability: Annotated[str, Choice(tuple(PERMEABILITIES))] = Field(
        default="exponential",
        description="Law of the permeability: constant, k0; exponential, k0 exp(M (J - 1)); that of Holmes and Mow, "
        "k0 ((J - 1 + n_f0)/n_f0)^a exp(M (J^2 - 1)/2); a power of the solid fraction, alpha (1 - n_f)^-M; or that of "
        "Kozeny and Carman, k0 (n_f/n_f0)^3 ((1 - n_f0)/(1 - n_f))^2.",
    )
    hydraulic_permeability: Annotated[_Varying | None, Quantity("hydraulic permeability", above=0.0, varying=True)] = (
        Field(default=None, description="Permeability at J = 1, k0.")
    )
    permeability_coefficient: Annotated[
        _Varying | None, Quantity("hydraulic permeability", above=0.0, varying=True)
    ] = Field(default=None, description="alpha of the permeability by the solid fraction.")
    permeability_exponent: Annotated[_Varying, Quantity(varying=True)] = Field(
        default=0.0, description="M of the law of the permeability."
    )
    permeability_power: Annotated[_Varying | None, Quantity(at_least=0.0, varying=True)] = Field(
        default=None, description="a of the Holmes-Mow permeability, which needs it; other laws do not take it."
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
        """As for every table; and the parameters of a law go with the law that uses them."""
        problems = super().presence_problems(table)
        for kind, laws in _LAWS.items():
            chosen = table.get(kind, cls.model_fields[kind].default)
            if not isinstance(chosen, str) or chosen not in laws:
                continue  # reported as a wrong choice, or as missing
            own = laws[chosen]._fields
            for key in dict.fromkeys(field for law in laws.values() for field in law._fields):
                if key in own and key not in table and cls.model_fields[key].default is None:
                    problems.append((key, f'missing; {kind} = "{chosen}" needs it'))
                if key not in own and key in table:
                    names = " or ".join(f'"{name}"' for name, law in laws.items() if key in law._fields)
                    problems.append((key, f"is for {kind} = {names} only"))
        return problems

    def at(self, coordinates: Coordinates, bath: Bath) -> Tissue:
        """Tissue at points; numbers where homogeneous, arrays (points,) where varying."""

        def value(quantity: float | Profile) -> Array | float:
            return quantity.at(coordinates) if isinstance(quantity, Profile) else quantity

        def law(kind: str) -> Any:
            chosen: Any = _LAWS[kind][getattr(self, kind)]
            return chosen(*(value(getattr(self, key)) for key in chosen._fields))

        if self.osmotic_coefficient is not None:
            coefficient = value(self.osmotic_coefficient)
        else:
            assert self.osmotic_coefficient_per_charge is not None  # one of the two is there
            fall = value(self.osmotic_coefficient_per_charge) * value(self.fixed_charge_density)
            coefficient = bath.osmotic_coefficient - fall
        return Tissue(
            solid=law("solid"),
            permeability=law("permeability"),
            osmotic=ConstantCoefficients(coefficient, bath.osmotic_coefficient, value(self.activity_ratio)),
            fluid_fraction=value(self.fluid_fraction),
            fixed_charge_density=value(self.fixed_charge_density),
            cation_diffusivity=value(self.cation_diffusivity),
            anion_diffusivity=value(self.anion_diffusivity),
            hindrance_factor=value(self.hindrance_factor),
            thermal_energy=GAS_CONSTANT * bath.temperature,
        )


def _with_default_scheme(table: Any) -> Any:
    return {"scheme": "esdirk43", **table} if isinstance(table, Mapping) else table


class CaseTable(Table):
    """Keys at the top of the file, and the tables."""

    title: Annotated[str, Text()] = Field(description="What is simulated, in a line.")
    model: Annotated[str, Choice(MODELS)] = Field(description="Which of the three models is solved.")
    assembly: Annotated[str, Choice(("compiled", "fipy", "stock-terms"))] = Field(
        default="compiled",
        description="How the equations are assembled and solved: compiled; as one FiPy term with FiPy's solvers; or, "
        "of a column, in FiPy's stock terms, which are slow, and readable as a specification.",
    )
    open_circuit_permeability: Annotated[str, Choice(("initial", "state", "none"))] = Field(
        default="initial",
        description="Permeability of the biphasic-swelling model: the open-circuit permeability of the "
        "equilibrated initial state at each point, the same evaluated with the state, or none: the tissue's "
        "own permeability.",
    )
    geometry: AnyGeometry
    tissue: TissueProperties
    bath: Bath
    boundary: ColumnBoundary | BlockBoundary = Field(default=ColumnBoundary(), validate_default=True)
    phase: tuple[ColumnPhase | BlockPhase, ...]
    time: Annotated[
        BackwardEuler | Esdirk43,
        Field(discriminator="scheme"),
        BeforeValidator(_with_default_scheme),
    ] = Esdirk43()
    output: Output = Field(default=Output(), validate_default=True)

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Parts of the boundary."""
        geometry: Any = self.geometry
        parts: tuple[Part, ...] = geometry.parts(self.boundary)
        return parts

    @field_validator("boundary", mode="wrap")
    @classmethod
    def _boundary_of_the_geometry(cls, boundary: Any, _: Any, info: ValidationInfo) -> Boundary:
        """Read the boundary as that of the geometry; of a column it need not be given."""
        geometry = info.data.get("geometry")
        table = type(geometry).boundary if geometry is not None else _geometry_of(info.context or {}).boundary
        content = {} if isinstance(boundary, ColumnBoundary) and table is not ColumnBoundary else boundary
        return table.model_validate(content)

    @field_validator("phase", mode="wrap")
    @classmethod
    def _phases_of_the_geometry(cls, phases: Any, _: Any, info: ValidationInfo) -> tuple[Phase, ...]:
        """Read phases as those of the geometry, even one that has problems of its own."""
        geometry = info.data.get("geometry")
        table = (_geometry_of(info.context or {}) if geometry is None else type(geometry)).phases
        read: tuple[Phase, ...] = _phase_reader(table).validate_python(phases)
        if not read:
            raise ValueError("must hold at least one [[phase]]")
        return read

    @field_validator("output", mode="before")
    @classmethod
    def _with_default_output(cls, output: Any, info: ValidationInfo) -> Any:
        """Write as the time stepping has it where nothing says when."""
        content = output.model_dump(exclude_none=True) if isinstance(output, Output) else output
        if not isinstance(content, Mapping) or any(key in content for key in Output.alternatives):
            return output
        time: TimeStepping = info.data.get("time", Esdirk43())
        return {**content, **time.default_output}

    @classmethod
    def inner_table(cls, content: Mapping[str, Any], key: str, item: Any) -> type[Table] | None:
        """As for every table; the boundary and the phases are those of the geometry."""
        if key == "phase":
            return _geometry_of(content).phases
        return _geometry_of(content).boundary if key == "boundary" else super().inner_table(content, key, item)


def _geometry_of(content: Mapping[str, Any]) -> type[Geometry]:
    """Table of the geometry of a case, from its raw content; of a column where nothing says what it is."""
    geometry: Any = variant(inner_tables(CaseTable, "geometry"), content.get("geometry"))
    return ColumnGeometry if geometry is None else geometry


@cache
def _phase_reader(table: type[Phase]) -> TypeAdapter[Any]:
    return TypeAdapter(tuple[table, ...])  # type: ignore[valid-type]

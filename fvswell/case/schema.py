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
from fvswell.case.tables import Table, inner_tables, variant
from fvswell.case.time_stepping import BackwardEuler, Esdirk43, Output, TimeStepping
from fvswell.case.tissue import TissueProperties
from fvswell.case.values import Choice, Quantity, Text
from fvswell.physics.models import MODELS as _MODELS

__all__ = ["MODELS", "Bath", "CaseTable", "TissueProperties"]

MODELS = tuple(_MODELS)


class Bath(Table):
    """The bath that the sample is equilibrated in before the first phase."""

    concentration: Annotated[float, Quantity("concentration", above=0.0)] = Field(
        description="Concentration of the monovalent salt before the first phase."
    )
    osmotic_coefficient: Annotated[float | None, Quantity(above=0.0)] = Field(
        default=None,
        description="Osmotic coefficient of the bath, phi_ext: 0.93 of the activity law without it; the constant and "
        "the charge-dependent law need it, and the ideal law has none.",
    )
    temperature: Annotated[float, Quantity("temperature", above=0.0)] = Field(
        default=298.0, description="Absolute temperature of bath and tissue."
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

"""The ``[tissue]`` table of a case: its laws with their parameters, and its families of fibres."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Protocol

from pydantic import Field

from fvswell.case.errors import Location
from fvswell.case.law_keys import LawTable
from fvswell.case.profiles import Coordinates, DepthProfile, PlaneProfile, Profile
from fvswell.case.values import Choice, Quantity
from fvswell.physics.constants import GAS_CONSTANT
from fvswell.physics.fibre_directions import FIBRE_DIRECTIONS
from fvswell.physics.fibre_laws import FIBRE_LAWS
from fvswell.physics.fibres import FibreFamily, with_fibres
from fvswell.physics.osmotic import OSMOTIC_LAWS
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.solids import SOLIDS
from fvswell.physics.tissue import Tissue

__all__ = ["Fibres", "TissueProperties"]

_Varying = float | DepthProfile | PlaneProfile
_PRESSURE = Quantity("pressure", above=0.0, varying=True)
_PERMEABILITY = Quantity("hydraulic permeability", above=0.0, varying=True)
_DIFFUSIVITY = Quantity("diffusivity", above=0.0, varying=True)


class _Bath(Protocol):
    """What the laws of the tissue take from the bath."""

    @property
    def osmotic_coefficient(self) -> float | None:
        """phi_ext, None where the law has its own."""

    @property
    def temperature(self) -> float:
        """Absolute, K."""


class Fibres(LawTable):
    """A family of fibres, which carry load in tension only, beside the ground substance."""

    laws: ClassVar = {"directions": FIBRE_DIRECTIONS, "law": FIBRE_LAWS}

    directions: Annotated[str, Choice(tuple(FIBRE_DIRECTIONS))] = Field(
        description="How the directions in the stress-free solid are distributed: all alike, all in a plane alike, or "
        "along one direction, or two that mirror each other."
    )
    normal: Annotated[str | None, Choice(("x", "y", "z"))] = Field(
        default=None,
        description='Normal of the plane of planar fibres, "y" without it: the axis of a column or a disc. x is the '
        "radius of a disc, z its hoop, or out of the plane of a block.",
    )
    angle: Annotated[_Varying | None, Quantity(at_least=-360.0, at_most=360.0, varying=True)] = Field(
        default=None, description="Angle of the direction from x toward y, in degrees: 90 is along the axis, y."
    )
    tilt: Annotated[_Varying | None, Quantity(at_least=-90.0, at_most=90.0, varying=True)] = Field(
        default=None,
        description="Angle of the direction out of the plane of x and y, to both sides alike, in degrees, 0 without "
        "it: 90 is along the hoop of a disc.",
    )
    law: Annotated[str, Choice(tuple(FIBRE_LAWS))] = Field(
        default="power",
        description="Law of a fibre of stretch lambda: psi = xi/(alpha beta) (exp(alpha (lambda^2 - 1)^beta) - 1), "
        "xi/beta (lambda^2 - 1)^beta with alpha = 0; or that of Wilson et al. (2004), with the nominal stress E1 "
        "(exp(k1 ln lambda) - 1).",
    )
    modulus: Annotated[_Varying | None, Quantity("pressure", at_least=0.0, varying=True)] = Field(
        default=None,
        description="xi of the power law, or E1 of the logarithmic one: of all fibres of the family together, "
        "whatever their directions.",
    )
    exponent: Annotated[_Varying | None, Quantity(at_least=0.0, varying=True)] = Field(
        default=None, description="alpha of the power law, 0 without it; or k1 of the logarithmic one, which needs it."
    )
    power: Annotated[_Varying | None, Quantity(at_least=2.0, varying=True)] = Field(
        default=None, description="beta of the power law, 2 without it."
    )

    def at(self, coordinates: Coordinates) -> FibreFamily:
        """The family at points."""
        return FibreFamily(self.law_of("directions", coordinates), self.law_of("law", coordinates))


class TissueProperties(LawTable):
    """Properties of the tissue; those with an initial value are of its reference state."""

    alternatives = ("osmotic_coefficient", "osmotic_coefficient_per_charge")
    needs_alternative = False
    laws: ClassVar = {"solid": SOLIDS, "permeability": PERMEABILITIES, "osmotic": OSMOTIC_LAWS}
    of_all = Tissue._fields

    solid: Annotated[str, Choice(tuple(SOLIDS))] = Field(
        description="Constitutive law of the solid: that of Wilson et al. (2005), eq 10; that of Bonet and "
        "Wood with the logarithm of J; that of Holmes and Mow with exponential stiffening; or that of Wilson et al. "
        "(2007), whose Poisson's ratio follows the solid fraction. With fibres, of the ground substance."
    )
    youngs_modulus: Annotated[_Varying | None, _PRESSURE] = Field(
        default=None, description="Young's modulus of the drained solid at small strain, E."
    )
    poisson_ratio: Annotated[_Varying | None, Quantity(above=-1.0, below=0.5, varying=True)] = Field(
        default=None, description="Poisson's ratio of the drained solid at small strain, nu."
    )
    shear_modulus: Annotated[_Varying | None, _PRESSURE] = Field(
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
    hydraulic_permeability: Annotated[_Varying | None, _PERMEABILITY] = Field(
        default=None, description="Permeability in the reference state; k0 if that is stress-free."
    )
    permeability_coefficient: Annotated[_Varying | None, _PERMEABILITY] = Field(
        default=None, description="alpha of the permeability by the solid fraction."
    )
    permeability_exponent: Annotated[_Varying | None, Quantity(varying=True)] = Field(
        default=None, description="M of the law of the permeability; 0 of the exponential law without it."
    )
    permeability_power: Annotated[_Varying | None, Quantity(at_least=0.0, varying=True)] = Field(
        default=None, description="a of the Holmes-Mow permeability, which needs it; other laws do not take it."
    )
    fluid_fraction: Annotated[_Varying, Quantity(above=0.0, below=1.0, varying=True)] = Field(
        description="Volume fraction of the fluid in the reference state; n_f0 if that is stress-free."
    )
    fixed_charge_density: Annotated[_Varying, Quantity("concentration", at_least=0.0, varying=True)] = Field(
        description="Fixed negative charge per volume of fluid in the reference state (one equivalent is one mole); "
        "c_F0 if that is stress-free."
    )
    osmotic: Annotated[str | None, Choice(tuple(OSMOTIC_LAWS))] = Field(
        default=None,
        description="Law of the ions: ideal solutions; constant coefficients; Wilson et al. (2005), eq 14, for baths "
        "of about 0.05 to 0.15 M; or that of Huyghe et al. (2003), whose coefficients follow the concentrations and "
        "which holds in any bath. Without it, the law of the osmotic coefficient that is given, and activity where "
        "none is.",
    )
    osmotic_coefficient: Annotated[_Varying | None, Quantity(above=0.0, varying=True)] = Field(
        default=None, description="Osmotic coefficient inside the tissue, phi_int, of the constant law."
    )
    osmotic_coefficient_per_charge: Annotated[_Varying | None, Quantity("volume per charge", varying=True)] = Field(
        default=None,
        description="X in phi_int = phi_ext - X c_F0, Wilson et al. (2005), eq 14, of the charge-dependent law; "
        "phi_int must be above 0.",
    )
    activity_ratio: Annotated[_Varying | None, Quantity(above=0.0, varying=True)] = Field(
        default=None,
        description="Square of the ratio of the activity coefficients outside and inside, of the constant and the "
        "charge-dependent law; 1 without it.",
    )
    cation_diffusivity: Annotated[_Varying, _DIFFUSIVITY] = Field(description="Diffusivity of the cation, D+.")
    anion_diffusivity: Annotated[_Varying, _DIFFUSIVITY] = Field(description="Diffusivity of the anion, D-.")
    hindrance_factor: Annotated[_Varying, Quantity(at_least=0.0, at_most=1.0, varying=True)] = Field(
        default=0.0, description="r: the water drags the ions along with 1 - r of its velocity."
    )
    reference_state: Annotated[str, Choice(("stress-free", "equilibrated"))] = Field(
        default="stress-free",
        description="Which state height, fluid fraction, fixed charge density and permeability are of: the stress-free "
        "solid, J = 1; or the sample as it was measured, unloaded and in equilibrium with the first bath, from which "
        "the stress-free numbers are found.",
    )
    fibres: tuple[Fibres, ...] = ()

    @classmethod
    def law_left_out(cls, kind: str, table: Mapping[str, Any]) -> str | None:
        """As for every table; the osmotic law is that of the coefficient which is given."""
        if kind != "osmotic":
            return super().law_left_out(kind, table)
        if "osmotic_coefficient_per_charge" in table:
            return "charge-dependent"
        return "constant" if "osmotic_coefficient" in table else "activity"

    @classmethod
    def displaced(cls, key: str, content: Mapping[str, Any]) -> Collection[str]:
        """As for every table; and an osmotic coefficient brings its law along."""
        displaced = super().displaced(key, content)
        return (*displaced, "osmotic") if key in cls.alternatives else displaced

    @property
    def profiles(self) -> dict[Location, Profile]:
        """All that varies in space, by the keys from here on."""

        def found() -> Iterator[tuple[Location, Any]]:
            yield from (((key,), value) for key, value in self)
            for index, family in enumerate(self.fibres):
                yield from ((("fibres", index, key), value) for key, value in family)

        return {place: value for place, value in found() if isinstance(value, DepthProfile | PlaneProfile)}

    def at(self, coordinates: Coordinates, bath: _Bath) -> Tissue:
        """Tissue at points, with the numbers of its reference state; arrays (points,) where it varies."""
        ground = self.law_of("solid", coordinates)
        numbers = {key: self.value(key, coordinates) for key in Tissue._fields[3:-1]}
        return Tissue(
            solid=with_fibres(ground, [family.at(coordinates) for family in self.fibres]),
            permeability=self.law_of("permeability", coordinates),
            osmotic=self.law_of("osmotic", coordinates, bath_osmotic_coefficient=bath.osmotic_coefficient),
            thermal_energy=GAS_CONSTANT * bath.temperature,
            **numbers,
        )

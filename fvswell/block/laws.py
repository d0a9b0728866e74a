"""What depends on the laws of the tissue in a block, each function compiled once for each combination of laws.

Arguments are arrays with the points last: the tissue, row by row as `tissue_parameters` has it, what the laws are
evaluated at, and results, which are set. Potentials and balances are in the order volume, anions, charge.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fvswell.compiled import law_at, law_kernel
from fvswell.compiled.dual import slope_of, value_of, variables
from fvswell.physics.fluxes import mixture_fluxes
from fvswell.physics.models import Model
from fvswell.physics.osmotic import ion_concentrations, osmotic_pressure
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import piola_stress
from fvswell.physics.tissue import Tissue, first_rows, fixed_charge_density, tissue_at

__all__ = ["cell_law", "face_law", "solid_law"]


def solid_law(tissue: Tissue) -> Any:
    """Compiled `solid_stress` of a tissue."""
    return law_kernel(solid_stress, (2, 2, 2, 3), type(tissue.solid))


def cell_law(tissue: Tissue) -> Any:
    """Compiled `cell_state` of a tissue."""
    return law_kernel(cell_state, (2, 1, 1, 2, 2), *_laws(tissue))


def face_law(tissue: Tissue, model: Model, open_circuit_of_state: bool) -> Any:
    """Compiled fluxes of a model."""
    if model.transports_ions:
        return law_kernel(full_fluxes, (2, 1, 1, 2, 2, 3), *_laws(tissue))
    return law_kernel(reduced_fluxes, (2, 1, 1, 2, 2, 3), *_laws(tissue), open_circuit_of_state)


def _laws(tissue: Tissue) -> tuple[type, type, type]:
    return type(tissue.solid), type(tissue.permeability), type(tissue.osmotic)


def solid_stress(solid: type) -> Callable[..., None]:
    """First Piola-Kirchhoff stress P = sigma cof F, (5, points), and its derivative by F, (5, 5, points).

    F and P are (xx, xy, yx, yy, zz); parameters are those of the solid and, last, the fluid fraction.
    """

    def evaluate(parameters: Any, F: Any, stress: Any, tangent: Any) -> None:
        last = parameters.shape[0] - 1
        for i in range(F.shape[1]):
            law = law_at(solid, parameters, 0, i)
            piola = piola_stress(law, parameters[last, i], variables(F[0, i], F[1, i], F[2, i], F[3, i], F[4, i]))
            for component in range(5):
                stress[component, i] = value_of(piola[component])
                for by in range(5):
                    tangent[component, by, i] = slope_of(piola[component], by)

    return evaluate


def cell_state(solid: type, permeability: type, osmotic: type) -> Callable[..., None]:
    """Osmotic pressure and content of anions, (3, points) each: the values, and their slopes by J and by ln a~."""
    first = first_rows(solid, permeability, osmotic)

    def evaluate(cells: Any, volume_ratio: Any, log_activity: Any, pressure: Any, content: Any) -> None:
        for i in range(len(volume_ratio)):
            tissue = tissue_at(solid, permeability, osmotic, first, cells, i)
            J, activity = variables(volume_ratio[i], log_activity[i])
            charge = fixed_charge_density(tissue, J)
            cation, anion = ion_concentrations(tissue.osmotic, charge, activity)
            pi = 0.0 * J + osmotic_pressure(tissue.osmotic, tissue.thermal_energy, charge, cation, anion)
            s = (J - 1.0 + tissue.fluid_fraction) * anion
            pressure[0, i] = value_of(pi)
            content[0, i] = value_of(s)
            for by in range(2):
                pressure[1 + by, i] = slope_of(pi, by)
                content[1 + by, i] = slope_of(s, by)

    return evaluate


def full_fluxes(solid: type, permeability: type, osmotic: type) -> Callable[..., None]:
    """Fluxes of the model that transports ions, (3, points), and their slopes, (3, 5, points).

    They are taken at J, ln a~ and the normal gradients of the potentials, (3, points); the slopes are by these five.
    """
    first = first_rows(solid, permeability, osmotic)

    def evaluate(
        faces: Any, volume_ratio: Any, log_activity: Any, gradients: Any, fluxes: Any, slopes: Any
    ) -> None:  # fmt: skip
        for i in range(len(volume_ratio)):
            tissue = tissue_at(solid, permeability, osmotic, first, faces, i)
            J, activity, water, salt, electric = variables(
                volume_ratio[i], log_activity[i], gradients[0, i], gradients[1, i], gradients[2, i]
            )
            cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
            flux = mixture_fluxes(tissue, J, cation, anion, water, salt, electric)
            through = (flux.water, flux.anion, flux.cation - flux.anion)
            for balance in range(3):
                fluxes[balance, i] = value_of(through[balance])
                for by in range(5):
                    slopes[balance, by, i] = slope_of(through[balance], by)

    return evaluate


def reduced_fluxes(
    solid: type, permeability: type, osmotic: type, open_circuit_of_state: bool
) -> Callable[..., None]:  # fmt: skip
    """Flux of water, (1, points), in the models with one balance, and its slopes by J, ln a~ and gradient.

    The ions are those in equilibrium with the given ln a~, which is constant. ``open_circuit_of_state`` says that
    k_open/k follows the state, rather than the last row of ``faces``.
    """
    first = first_rows(solid, permeability, osmotic)

    def evaluate(
        faces: Any, volume_ratio: Any, log_activity: Any, gradients: Any, fluxes: Any, slopes: Any
    ) -> None:  # fmt: skip
        for i in range(len(volume_ratio)):
            tissue = tissue_at(solid, permeability, osmotic, first, faces, i)
            J, gradient = variables(volume_ratio[i], gradients[0, i])
            k = 0.0 * J + hydraulic_permeability(tissue, J)
            if open_circuit_of_state:
                charge = fixed_charge_density(tissue, J)
                cation, anion = ion_concentrations(tissue.osmotic, charge, log_activity[i])
                k = k * open_circuit_ratio(tissue, J, cation, anion)
            else:
                k = k * faces[faces.shape[0] - 1, i]
            flux = -k * gradient
            fluxes[0, i] = value_of(flux)
            slopes[0, 0, i] = slope_of(flux, 0)
            slopes[0, 1, i] = 0.0
            slopes[0, 2, i] = slope_of(flux, 1)

    return evaluate

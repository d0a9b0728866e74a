"""The three models: one set of equations, three declarations of what is transported and what makes it swell.

What is balanced, per reference volume:

    balance   content        flux            driven by
    volume    J              q               mu_f
    anion     s = J n_f c-   j-              ln a~
    charge    none           i/F = j+ - j-   psi~ (as F psi~/(R T))
"""

from __future__ import annotations

from dataclasses import dataclass

from fvswell.physics.osmotic import NoSwelling
from fvswell.physics.tissue import Tissue

__all__ = ["BIPHASIC", "BIPHASIC_SWELLING", "ELECTROCHEMICAL", "MODELS", "Model"]


@dataclass(frozen=True)
class Model:
    """What a model transports, whether fixed charge makes it swell, and its permeability."""

    name: str
    balances: tuple[str, ...]
    swelling: bool
    open_circuit: bool  # water meets the streaming potential through its permeability alone

    @property
    def transports_ions(self) -> bool:
        """Whether ions diffuse, migrate and are dragged, or are always in equilibrium with the bath."""
        return "anion" in self.balances

    def tissue(self, tissue: Tissue) -> Tissue:
        """The tissue as this model sees it: without swelling, its osmotic pressure is nothing."""
        return tissue if self.swelling else tissue._replace(osmotic=NoSwelling())


BIPHASIC = Model("biphasic", balances=("volume",), swelling=False, open_circuit=False)
BIPHASIC_SWELLING = Model("biphasic-swelling", balances=("volume",), swelling=True, open_circuit=True)
ELECTROCHEMICAL = Model("electrochemical", balances=("volume", "anion", "charge"), swelling=True, open_circuit=False)
MODELS = {model.name: model for model in (BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL)}

"""The starter with the properties of a tissue."""

from __future__ import annotations

import numpy as np
import pytest

from fvswell.case.case import Case, CaseError
from fvswell.case.plausibility import warnings_of
from fvswell.case.starter import starter_of_tissue
from fvswell.physics.fibres import ground_and_families
from fvswell.physics.tissues import TISSUES


@pytest.mark.parametrize("name", TISSUES)
def test_case_has_the_properties_of_the_set_and_says_where_they_are_from(name: str) -> None:
    text, chosen = starter_of_tissue(name), TISSUES[name]
    case = Case.from_toml(text)
    for key, value in chosen.properties.items():
        found = getattr(case.tissue, key)
        assert found == (value if isinstance(value, str) else pytest.approx(value, rel=1e-5))
    assert len(ground_and_families(case.tissue_at(np.zeros(1)).solid)[1]) == len(chosen.fibres)
    comment = " ".join(line.lstrip("# ") for line in text.splitlines() if line.startswith("#"))
    assert chosen.source in comment
    assert chosen.assumed in comment
    assert warnings_of(case) == []


def test_unknown_tissue() -> None:
    with pytest.raises(CaseError, match="did you mean annulus-fibrosus"):
        starter_of_tissue("annulus")

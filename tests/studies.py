"""Small studies for the tests."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import xarray as xr

from fvswell.case.case import Case
from fvswell.study.study import Study

CASES = Path(__file__).parent.parent / "cases"
SMALL = {"geometry.cells": 12, "time.scheme": "backward-euler", "time.steps_per_phase": 8}


def protocol(name: str = "compression", file: str = "confined_compression.toml", **changes: Any) -> dict[str, Any]:
    """A protocol with a coarse case; keys of the changes have __ for dots."""
    own = {key.replace("__", "."): value for key, value in changes.items()}
    return {"name": name, "case": str(CASES / file), "changes": SMALL | own}


def parameter(name: str, key: str | list[str], low: Any, high: Any, **others: Any) -> dict[str, Any]:
    """A parameter."""
    return {"name": name, "key": key, "low": low, "high": high, **others}


STIFFNESS = parameter("stiffness", "tissue.youngs_modulus", "0.3 MPa", "0.6 MPa")
PERMEABILITY = parameter(
    "permeability", "tissue.hydraulic_permeability", "5e-4 mm^4/(N s)", "2e-3 mm^4/(N s)", spacing="log"
)
HEIGHT = parameter("height", "geometry.height", "0.4 mm", "0.6 mm")


def content(**changes: Any) -> dict[str, Any]:
    """Content of a study file with some tables replaced, None taking them away."""
    tables = {
        "title": "A small study",
        "protocol": [protocol()],
        "parameter": [STIFFNESS, PERMEABILITY],
        "design": [{"name": "all", "kind": "grid", "counts": {"stiffness": 2, "permeability": 2}}],
    }
    return {key: value for key, value in (tables | changes).items() if value is not None}


def text(**changes: Any) -> str:
    """The same as a text."""
    return tomli_w.dumps(content(**changes))


def study(**changes: Any) -> Study:
    """The same as a study."""
    return Study.from_toml(text(**changes))


def many_batches() -> dict[str, Any]:
    """Tables of a study of six batches of two: each height has a grid of its own."""
    return {
        "protocol": [protocol(geometry__cells=6, phase__loading__duration="200 s", phase__unloading__duration="300 s")],
        "parameter": [STIFFNESS, HEIGHT],
        "design": [{"name": "all", "kind": "grid", "counts": {"height": 6, "stiffness": 2}}],
        "strain_curves": True,
    }


def assert_identical(one: xr.Dataset, other: xr.Dataset) -> None:
    """All data the same bit for bit, and all attributes but the time of writing."""
    assert list(one.variables) == list(other.variables)
    for name in one.variables:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=str(name))
        assert one[name].attrs == other[name].attrs
    assert one.attrs | {"history": ""} == other.attrs | {"history": ""}


def case_content(case: Case) -> dict[str, Any]:
    """What a case file with this case holds."""
    return tomllib.loads(case.to_toml())

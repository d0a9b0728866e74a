"""Functions of a point and generic functions, in Python and compiled."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from fvswell.compiled import dispatch, law_at
from fvswell.physics.permeability import permeability

OWN = Path(__file__).with_name("own_laws.py")


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The laws of a user's own file, forgotten afterwards."""
    monkeypatch.setattr(dispatch, "_noted", [*dispatch._noted])
    monkeypatch.setattr(dispatch, "_generic", [*dispatch._generic])
    import own_laws

    yield own_laws
    permeability.implementations.pop(own_laws.Linear)
    del sys.modules["own_laws"]


def test_a_function_of_a_point_stays_as_it_is(own: ModuleType) -> None:
    assert own.twice(3.0) == 6.0
    assert own.twice in dispatch.noted_functions()
    assert own.linear in dispatch.noted_functions()


def test_the_law_chooses_the_implementation(own: ModuleType) -> None:
    assert own.response(own.Linear(2.0), 3.0) == 6.0
    assert own.response(own.Quadratic(2.0, 1.0), 3.0) == 21.0
    np.testing.assert_array_equal(own.response(own.Linear(np.array([1.0, 2.0])), 3.0), [3.0, 6.0])
    assert own.response.implementations == {own.Linear: own.linear, own.Quadratic: own.quadratic}


def test_a_law_nobody_registered_is_refused(own: ModuleType) -> None:
    with pytest.raises(KeyError):
        own.response((1.0,), 2.0)


def test_parameters_at_a_point(own: ModuleType) -> None:
    assert law_at(own.Quadratic, np.arange(12.0).reshape(4, 3), 1, 2) == own.Quadratic(5.0, 8.0)


def test_laws_of_a_users_own_file_run_compiled_and_differentiated(tmp_path: Path) -> None:
    """Several types of law in one kernel, with exact derivatives; one is a new law of an old generic function."""
    done = subprocess.run(
        [sys.executable, OWN], env=os.environ | {"FVSWELL_CACHE_DIR": str(tmp_path)}, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    found = [float(value) for value in done.stdout.split()]
    np.testing.assert_allclose(found, [8.0, 2.0, 32.0, 10.0, 1e-3, 7.6, 2.0], rtol=1e-15)

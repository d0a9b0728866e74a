"""Groups of phases that are repeated."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
import tomli_w
from sample_cases import small_compression

from fvswell import CaseError
from fvswell.case.case import Case

GROUP = """
[[phase]]
name = "cycle"
repeat = 3

[[phase.phase]]
name = "loading"
duration = 20
piston.pressure = { ramp_to = 0.1, over = 10 }

[[phase.phase]]
name = "rest"
duration = "1 min"
piston.pressure = 0
"""


def with_phases(text: str) -> str:
    """The small compression with other phases."""
    content = tomllib.loads(small_compression().to_toml())
    content["phase"] = tomllib.loads(text)["phase"]
    return tomli_w.dumps(content)


def test_a_group_stands_for_its_phases_in_a_row() -> None:
    single = '[[phase]]\nname = "before"\nduration = 5\npiston.pressure = 0.05\n'
    case = Case.from_toml(with_phases(single + GROUP))
    names = ["before", *(f"cycle {n} {name}" for n in (1, 2, 3) for name in ("loading", "rest"))]
    assert [phase.name for phase in case.phase] == names
    assert [phase.duration for phase in case.phase] == [5.0, *[20.0, 60.0] * 3]
    assert Case.from_toml(case.to_toml()) == case
    assert case.with_changes({"phase.cycle 2 rest.duration": 7.0}).phase[4].duration == 7.0


def broken(old: str, new: str) -> list[str]:
    with pytest.raises(CaseError) as error:
        Case.from_toml(with_phases(GROUP.replace(old, new)))
    return [str(problem) for problem in error.value.problems]


@pytest.mark.parametrize(
    ("old", "new", "problems"),
    [
        ("repeat = 3", "repeat = 0", ["phase[cycle].repeat = 0: must be a whole number from 1 to 10000"]),
        ("repeat = 3", "", ["phase[cycle].repeat: missing; how many times the phases follow one another"]),
        ('name = "cycle"', "", ["phase[0].name: missing; a group of phases has a name"]),
        ("repeat = 3", "repeat = 3\nduration = 5", ["phase[cycle].duration = 5: is no key of a group of phases; lo"]),
        ("repeat = 3", "repaet = 3", ["phase[cycle].repaet = 3: is no key of a group of phases; did you mean repeat?",
                                      "phase[cycle].repeat: missing"]),
        ("duration = 20", "duration = -20", ["phase[cycle 1 loading].duration = -20: must be above 0"]),
        ("over = 10", "over = 100", ["phase[cycle 1 loading].piston.pressure"]),
        ("piston.pressure = 0\n", "bath_concentration = 0\n", ["phase[cycle 1 rest].bath_concentration = 0: must be"]),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_group_is_said_once(old: str, new: str, problems: list[str]) -> None:
    found = broken(old, new)
    assert len(found) == len(problems)
    for one, other in zip(found, problems, strict=True):
        assert one.startswith(other)


def test_what_is_wrong_from_the_second_round_on_is_said_of_that() -> None:
    """The piston begins at 0 in the first round, and where that has left it in the second."""
    loads = {"piston.pressure = { ramp_to = 0.1, over = 10 }": "piston.displacement = 0",
             "piston.pressure = 0\n": "piston.displacement = { ramp_to = -0.01, over = 10 }\n"}  # fmt: skip
    text = GROUP
    for old, new in loads.items():
        text = text.replace(old, new)
    with pytest.raises(CaseError) as error:
        Case.from_toml(with_phases(text))
    (problem,) = error.value.problems
    assert problem.key == "phase[cycle 2 loading].piston.displacement"


def test_groups_are_not_nested() -> None:
    content: dict[str, Any] = tomllib.loads(GROUP)
    assert "phase" in content["phase"][0]
    found = broken('[[phase.phase]]\nname = "rest"', '[[phase.phase]]\nrepeat = 2\nname = "rest"')
    assert any("must hold phases only: groups are not nested" in problem for problem in found)

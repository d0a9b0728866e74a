"""Case files with random mistakes: each is a case, or is refused with words; nothing else ever comes of it."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_cases import CASES

from fvswell.case.case import Case, CaseError

TEXTS = {path.stem: path.read_text(encoding="utf-8") for path in sorted(CASES.glob("*.toml"))}
WORDS = st.one_of(
    st.sampled_from(
        [
            "0", "-1", "1e300", "1e-300", "nan", "inf", "true", '""', "[]", "{}", "[0, 0]", '"1 mm"', '"1e9 MPa"',
            '"0 s"', '"-5 degC"', '"1e400 m"', '"relaxation times"', '"9 relaxation times"', '"column"',
            '"plane-strain"', '"axisymmetric"', '"holmes-mow"', '"straight"', "{ramp_to = 1, over = 2}",
            "{depth = [0, 1], value = [1, 2]}", "{x = [0], y = [0, 1], value = [[1], [2]]}", "1979-05-27", "[[phase]]",
        ]
    ),
    st.text(max_size=5),
)  # fmt: skip


@st.composite
def altered(draw: st.DrawFn, text: str) -> str:
    """A text with one to three lines left out, doubled, moved, or given another value."""
    lines = text.splitlines()
    for _ in range(draw(st.integers(1, 3))):
        index = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from(["leave out", "double", "move", "value", "key"]))
        key, equals, _ = lines[index].partition("=")
        if kind == "leave out":
            del lines[index]
        elif kind == "double":
            lines.insert(index, lines[index])
        elif kind == "move":
            lines.insert(draw(st.integers(0, len(lines) - 1)), lines.pop(index))
        elif kind == "value" and equals:
            lines[index] = f"{key}= {draw(WORDS)}"
        elif equals:
            lines[index] = lines[index].replace(
                key.strip(), draw(st.sampled_from(["cells", "name", "kind", "x", "solid"])), 1
            )
    return "\n".join(lines)


@pytest.mark.parametrize("name", TEXTS)
@settings(deadline=None, max_examples=150)
@given(data=st.data())
def test_mistakes_in_a_file_are_refused_with_words(name: str, data: st.DataObject) -> None:
    text = data.draw(altered(TEXTS[name]))
    try:
        case = Case.from_toml(text)
    except CaseError as error:
        refused = error
    else:
        assert Case.from_toml(case.to_toml()) == case
        return
    assert refused.problems
    assert all(problem.message for problem in refused.problems)

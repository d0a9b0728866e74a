"""The cases that come with fvswell, one for each kind of experiment."""

from __future__ import annotations

from pathlib import Path

from fvswell.case.errors import CaseError, Problem, nearest_name, shown

__all__ = ["shipped_cases", "shipped_text"]


def shipped_cases() -> dict[str, Path]:
    """Files of the cases by the name of the experiment, such as "stress-relaxation"."""
    package = Path(__file__).parent.parent
    folder = next(folder for folder in (package / "cases", package.parent / "cases") if folder.is_dir())
    return {path.stem.replace("_", "-"): path for path in sorted(folder.glob("*.toml"))}


def shipped_text(experiment: str) -> str:
    """Text of the case of an experiment.

    Raises
    ------
    CaseError
        If there is no such case.
    """
    cases = shipped_cases()
    name = experiment.replace("_", "-")
    if name not in cases:
        near = nearest_name(name, cases)
        hint = f"; did you mean {near}?" if near else ""
        raise CaseError([Problem("--like", shown(experiment), f"must be one of {', '.join(cases)}{hint}")], "new")
    return cases[name].read_text(encoding="utf-8")

"""The page of the docs about FiPy, run from its first line of Python to its last."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_page_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "fipy.md").read_text(encoding="utf-8")
    code = re.findall(r"^```python\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)
    assert len(code) > 8
    monkeypatch.chdir(ROOT)
    exec(compile("\n".join(code), "docs/fipy.md", "exec"), {"__name__": "page"})

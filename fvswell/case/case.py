"""The case: what is simulated, read from a TOML file, checked, changed and written back."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from functools import cached_property
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import PrivateAttr

from fvswell.case.changes import changed_content, with_numbers
from fvswell.case.checks import check_case
from fvswell.case.errors import CaseError, Problem, shown
from fvswell.case.load_files import LoadFile, files_beside
from fvswell.case.loads import TableLoad, shape_of
from fvswell.case.reading import problems_of
from fvswell.case.repeats import read_repeated
from fvswell.case.schema import MODELS, CaseTable
from fvswell.case.toml_file import file_text, toml_content
from fvswell.physics.tissue import Array, Tissue

__all__ = ["MODELS", "Case", "CaseError", "load_case", "parse_setting", "starter_text"]

_HEADER = "# Plain numbers are in mm, N, s, mmol, K: MPa, mmol/mm^3, mm^4/(N s), mm^2/s.\n"


class Case(CaseTable):
    """A simulation: title, model, geometry, tissue, bath, phases, time stepping and output.

    Made by ``load_case``, ``Case.from_toml`` and ``with_changes``, which check it. All values are in the
    internal units mm, N, s, mmol, K. Cases are equal if their resolved content is, wherever they came from.
    """

    _source: str = PrivateAttr(default="case")
    _folder: Path = PrivateAttr(default=Path())

    @classmethod
    def from_toml(cls, text: str, source: str = "case", folder: Path | None = None) -> Case:
        """Read and check a case.

        Parameters
        ----------
        text
            Content of a case file.
        source
            What to call it in messages.
        folder
            Where the files lie that its loads are in; the folder of ``source`` by default.

        Raises
        ------
        CaseError
            With every problem that the text has.
        """
        return cls._from_content(toml_content(text, source), source, folder or Path(source).parent)

    @classmethod
    def _from_content(cls, content: Mapping[str, Any], source: str, folder: Path = Path()) -> Case:
        with files_beside(folder):
            case = read_repeated(cls, content, source, check_case)
        case._source, case._folder = source, folder
        return case

    @property
    def source(self) -> str:
        """Where the case was read from."""
        return self._source

    @property
    def folder(self) -> Path:
        """Where the files of its loads lie."""
        return self._folder

    @property
    def load_files(self) -> dict[str, LoadFile]:
        """Files that loads have been read from, by the key of the load."""
        loads = {
            f"phase[{phase.name}].{'.'.join(place)}": shape_of(load)
            for phase in self.phase
            for place, load in phase.all_loads()
        }
        return {key: load.source for key, load in loads.items() if isinstance(load, TableLoad) and load.source}

    def changed_load_files(self) -> list[str]:
        """What is to be said of load files that are other ones now than when the case was read first.

        The case keeps what was in them then. A file that is not there any more is not missed.
        """
        return [
            f"{self.source}: {key}: {file.file} has changed; what it held when this case was first read is used"
            for key, file in self.load_files.items()
            if file.has_changed(self.folder)
        ]

    def tissue_at(self, points: Array) -> Tissue:
        """Tissue at points, with the numbers of its reference state, which `fvswell.case.reference_state` converts.

        Parameters
        ----------
        points
            Of the sample in its reference state, mm: of a column distances from the filter, shape (points,); of a block
            positions along x and y, shape (2, points).

        Returns
        -------
        Tissue
            Numbers for homogeneous properties and arrays of shape (points,) for varying ones.
        """
        return self.tissue.at(self.geometry.coordinates(points), self.bath)

    def with_changes(self, changes: Mapping[str, Any]) -> Case:
        """Checked copy with some values changed.

        Parameters
        ----------
        changes
            New values by dotted key, set in this order, such as
            ``{"tissue.hindrance_factor": 0.0, "model": "biphasic"}``. A phase goes by its name or its number
            from 0: ``"phase.loading.piston.pressure"``, ``"phase.0.duration"``. None takes a key away. A key
            that excludes another one takes its place. Output that is written as ``time.scheme`` has it by default
            still is if that is changed.

        Raises
        ------
        CaseError
            If a key is unknown or the changed case has any problem.
        """
        content: Mapping[str, Any] = self.content
        if content["output"] == self.time.default_output:
            content = {key: value for key, value in content.items() if key != "output"}
        content = changed_content(type(self), content, changes, self.source)
        return self._from_content(content, self.source, self.folder)

    def with_numbers(self, changes: Mapping[str, float], checked: bool = False) -> Case:
        """As `with_changes`, and faster, for numbers that are valid each by itself.

        Parameters
        ----------
        changes
            New numbers in internal units by dotted key.
        checked
            Whether it is known that they are valid together.

        Raises
        ------
        CaseError
            If the changed case has any problem.
        """
        case = with_numbers(self, changes)
        if case is None:
            return self.with_changes(changes)
        if not checked and (findings := list(check_case(case))):
            raise CaseError(problems_of(type(self), case.content, findings), self.source)
        return case

    def to_toml(self) -> str:
        """The resolved case in internal units, complete: ``Case.from_toml`` gives the same case back."""
        return _HEADER + tomli_w.dumps(self.content)

    @cached_property
    def sha256(self) -> str:
        """Checksum of the resolved case."""
        return hashlib.sha256(self.to_toml().encode()).hexdigest()

    @cached_property
    def content(self) -> dict[str, Any]:
        """The resolved case in internal units, as tables of plain values."""
        content = self.model_dump(exclude_none=True)
        if not self.tissue.fibres:
            del content["tissue"]["fibres"]
        return content

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Case) and self.content == other.content

    def __hash__(self) -> int:
        return hash(self.sha256)


def load_case(path: str | PathLike[str]) -> Case:
    """Read and check a case file.

    Raises
    ------
    CaseError
        If the file cannot be read, or with every problem that it has.
    """
    return Case.from_toml(file_text(Path(path)), str(path))


def parse_setting(setting: str) -> tuple[str, Any]:
    """Split ``key=value``; the value is read as in a TOML file and is taken as text if it cannot be.

    Raises
    ------
    CaseError
        If there is no key or no "=".
    """
    key, equals, text = setting.partition("=")
    key, text = key.strip(), text.strip()
    if not key or not equals:
        message = "must be key=value, such as tissue.hindrance_factor=0"
        raise CaseError([Problem("", shown(setting), message)], "setting")
    try:
        content = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return key, text
    return key, content["value"] if len(content) == 1 else text


def starter_text() -> str:
    """A commented case file to begin with."""
    return resources.files(__package__).joinpath("starter_case.toml").read_text(encoding="utf-8")

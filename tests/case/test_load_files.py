"""Loads in files as testing machines write them: separators, units, and all that can be wrong, at once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fvswell.case.load_files import LoadFile, files_beside
from fvswell.case.loads import Load, StrainLoad, TableLoad
from fvswell.case.values import Quantity

PRESSURE, LENGTH = Load(Quantity("pressure")), Load(Quantity("length"), strain=True)
TIMES, VALUES = (0.0, 0.1, 30.0, 60.0), (0.0, 0.05, 0.25, -0.1)
Read = Callable[..., Any]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Write a file and read a load from it."""

    def reader(text: str | bytes, time: str = "Time", value: str = "Stress", load: Load = PRESSURE, **keys: str) -> Any:
        path = tmp_path / "protocol.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        with files_beside(tmp_path):
            return load._read({"file": path.name, "time": time, "value": value, **keys})

    return reader


def written(header: str, separator: str, scale: float = 1.0) -> str:
    rows = [f"{time}{separator}7{separator}{scale * value!r}" for time, value in zip(TIMES, VALUES, strict=True)]
    return "\n".join([header, *rows, "", ""])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_what_separates_columns_does_not_matter(read: Read, separator: str, end: str) -> None:
    text = written(separator.join(["Time [s]", "Cycle", "Stress [MPa]"]), separator).replace("\n", end)
    load = read(text)
    assert (load.times, load.values) == (TIMES, VALUES)
    assert load == PRESSURE._read(PRESSURE._plain(load))
    inline = PRESSURE._read({"times": list(TIMES), "values": [f"{value} MPa" for value in VALUES]})
    assert (inline.times, inline.values) == (load.times, load.values)


@pytest.mark.parametrize(
    ("header", "scale"),
    [("Time [s],N,Stress [kPa]", 1e3), ("Time (s),N,Stress (MPa)", 1.0), ("Time / s,N,Stress / N/mm^2", 1.0)],
)
@pytest.mark.parametrize("whole", [True, False])
def test_units_in_the_header(read: Read, header: str, scale: float, whole: bool) -> None:
    """Columns are called with their units or without."""
    time, _, value = header.split(",")
    names = {"time": time, "value": value} if whole else {}
    load = read(written(header, ",", scale), **names)
    assert load.times == TIMES
    assert load.values == pytest.approx(VALUES, rel=1e-15, abs=1e-18)


def test_units_beside_the_names(read: Read) -> None:
    load = read(written("Time,N,Stress (engineering)", ","), value="Stress (engineering)", time_unit="min",
                value_unit="kPa")  # fmt: skip
    assert load.times == pytest.approx([60.0 * time for time in TIMES])
    assert load.values == pytest.approx([1e-3 * value for value in VALUES])


def test_names_and_numbers_in_quotes_and_a_mark_of_the_byte_order(read: Read) -> None:
    load = read(b'\xef\xbb\xbf"Time [s]","Stress, nominal [MPa]"\n"0","0.1"\n"1","0.2"\n', value="Stress, nominal")
    assert load == TableLoad((0.0, 1.0), (0.1, 0.2), load.source)


def test_strains_in_per_cent_in_place_of_displacements(read: Read) -> None:
    load = read("Time [s];Strain [%]\n0;0\n10;-5\n", value="Strain", load=LENGTH)
    assert load == StrainLoad(TableLoad((0.0, 10.0), (0.0, -0.05), load.strain.source))
    assert LENGTH._read(LENGTH._plain(load)) == load


def test_where_the_points_come_from_is_kept(read: Read, tmp_path: Path) -> None:
    source = read(written("Time [s],N,Stress [MPa]", ",")).source
    assert source == LoadFile("protocol.csv", "Time", "Stress", source.sha256)
    assert not source.has_changed(tmp_path)
    (tmp_path / "protocol.csv").write_text(written("Time [s],N,Stress [MPa]", ",", 2.0))
    assert source.has_changed(tmp_path)
    assert not source.has_changed(tmp_path / "elsewhere")


HEADER = "Time [s];Stress [MPa]\n"


@pytest.mark.parametrize(
    ("text", "keys", "messages"),
    [
        ("", {}, ["is empty"]),
        ("\n ; \n", {}, ["is empty"]),
        (HEADER, {}, ["holds no numbers below its first line"]),
        (HEADER + "0;1\n", {"time": "Tme", "value": "Load"},
         ['time: there is no column "Tme"; did you mean "Time [s]"?',
          'value: there is no column "Load"; there are "Time [s]", "Stress [MPa]"']),
        ("Time;Stress [mm]\n0;1\n", {},
         ['time: the unit of the column is missing or of another dimension, its header "Time" has none: add time_unit '
          '= "s"', 'value: the unit of the column is missing or of another dimension, its header says "Stress [mm]": '
          'add value_unit = "MPa"']),
        ("Time;Stress\n0;1\n", {"time_unit": "MPa", "value_unit": "ms"},
         ['time_unit = "MPa": must be a unit such as "s"', 'value_unit = "ms": must be a unit such as "MPa"']),
        (HEADER + "0;1\n", {"time_unit": "min"}, ['time_unit = "min": the file says "s": leave time_unit away']),
        (HEADER + "0;0,1\n1;0,2\n", {},
         ['line 2, Stress: "0,1" is not a number; decimals are written with a point: 0.1', "line 3"]),
        (HEADER.replace(";", ",") + "0,0,1\n1,0,2\n", {},
         ["line 2 has 3 fields where the first line has 2 names; decimals are written with a point"]),
        (HEADER + "0;1\n2;x\n1;nan\n3;\n4;1\n4\n", {},
         ['line 3, Stress: "x" is not a number', 'line 4, Stress: "nan": must be a finite number',
          "line 5, Stress: is empty", "and 1 more lines"]),
        (HEADER + "-1;1\n0;inf\n", {}, ['line 2, Time: "-1": must be at least 0 s', "line 3, Stress"]),
        (HEADER + "0;1\n2;1\n2;1\n1;1\n", {},
         ["line 4, Time: 2 does not increase, after 2", "line 5, Time: 1 does not increase, after 2"]),
        ("Time [s];Time [s];Stress [MPa]\n0;0;1\n", {}, ['time: there are 2 columns "Time"']),
        (b"Time [s];Stress [MPa]\n0;1\xb5\n", {}, ["is not UTF-8 text"]),
        (HEADER + '0;"1\n', {}, ["cannot be read as columns separated by semicolons"]),
        (HEADER + "0;1\n", {"tme_unit": "s"}, ["tme_unit: unknown key; did you mean time_unit?"]),
    ],
)  # fmt: skip
def test_everything_wrong_with_a_file_is_said_at_once(
    read: Read, text: str | bytes, keys: dict[str, str], messages: list[str]
) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the messages are looked for below
        read(text, **keys)
    for message in messages:
        assert message in str(error.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "protocol.csv").write_text("")
    for name in ("protocl.csv", "other/protocol.csv"):
        with files_beside(tmp_path), pytest.raises(ValueError, match="no such file") as error:
            PRESSURE._read({"file": name, "time": "Time", "value": "Stress"})
        assert ("did you mean protocol.csv" in str(error.value)) == (name == "protocl.csv")
    with files_beside(tmp_path), pytest.raises(ValueError, match="cannot be read: Is a directory"):
        PRESSURE._read({"file": ".", "time": "Time", "value": "Stress"})

"""The command line as a user meets it: what is printed where, what is written, and how it ends."""

from __future__ import annotations

import os
import pty
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from sample_cases import CASES, impossible_compression, small_compression
from typer.testing import CliRunner, Result

from fvswell import __version__
from fvswell.case.case import MODELS, load_case
from fvswell.cli.main import app
from fvswell.results.file import read_result

COMMAND = [sys.executable, "-m", "fvswell"]


@pytest.fixture(autouse=True)
def _in_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def case_file(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(small_compression().to_toml(), encoding="utf-8")
    return path


def fvswell(*arguments: str | Path) -> Result:
    """Run a command in this process; its output is no terminal."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def files() -> set[str]:
    return {str(path) for path in Path().rglob("*") if path.is_file()}


def test_help_needs_none_of_the_slow_libraries() -> None:
    script = (
        "import sys\nfrom typer.testing import CliRunner\nfrom fvswell.cli.main import app\n"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0\nprint(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    slow = {"fipy", "numpy", "scipy", "xarray", "netCDF4", "matplotlib", "pydantic", "pint", "rich"}
    assert not slow & set(loaded)


def test_help_answers_at_once() -> None:
    def seconds() -> float:
        """Of the processor: what the clock shows on a quiet machine, whatever else runs on this one."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([*COMMAND, "--help"], capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert min(seconds() for _ in range(3)) < 0.2


def test_help_names_every_command_and_option() -> None:
    text = fvswell("--help").stdout
    for command in ("run", "check", "new", "compare", "plot", "info"):
        assert re.search(rf"^  {command} ", text, re.MULTILINE)
        assert fvswell(command, "--help").exit_code == 0
    assert "..." not in text.split("Commands:")[1]  # descriptions that were cut off
    for option in ("--model", "--set", "--output", "--force", "--quiet"):
        assert option in fvswell("run", "--help").stdout
    assert fvswell("--version").stdout == f"fvswell {__version__}\n"


def test_run_says_what_it_does_and_writes_the_result(case_file: Path) -> None:
    done = fvswell("run", case_file)
    assert done.exit_code == 0
    assert done.stderr == ""
    assert files() == {"small.toml", "output/small/electrochemical.nc"}
    for part in (
        "Confined compression of reference cartilage",
        "model     electrochemical",
        "height 0.5 mm, cells 10",
        "fixed charge density 0.2 M",
        "durations loading 300 s, unloading 300 s",
        "16 steps",
        "wrote output/small/electrochemical.nc",
    ):
        assert part in done.stdout
    result = read_result("output/small/electrochemical.nc")
    for index in (8, 16):
        assert f"{100.0 * float(result['global_strain'][index]):+.3f} %" in done.stdout
    assert f"{int(result['step_iterations'].sum())} Newton iterations" in done.stdout
    assert "\x1b" not in done.stdout


def test_progress_without_a_terminal_is_a_line_at_every_tenth(case_file: Path) -> None:
    done = fvswell("run", case_file, "--set", "time.steps_per_phase=3000")
    shares = [int(share) for share in re.findall(r"electrochemical: +(\d+) %, t = ", done.stdout)]
    assert [share // 10 for share in shares] == list(range(1, 11))


def test_quiet_run_prints_nothing(case_file: Path) -> None:
    done = fvswell("run", case_file, "--quiet", "--model", "biphasic", "-o", "there")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "", "")
    assert read_result("there/biphasic.nc").attrs["model"] == "biphasic"


def test_settings_change_the_case(case_file: Path) -> None:
    fvswell("run", case_file, "-q", "--set", "tissue.hindrance_factor=0", "--set", "bath.temperature=37 degC")
    case = small_compression(tissue__hindrance_factor=0.0, bath__temperature=310.15)
    assert read_result("output/small/electrochemical.nc").attrs["case_sha256"] == case.sha256


def test_result_can_be_run_again(case_file: Path) -> None:
    fvswell("run", case_file, "-q", "--model", "biphasic-swelling", "--set", "geometry.cells=12")
    assert fvswell("run", "output/small/biphasic-swelling.nc", "-q", "-o", "again").exit_code == 0
    first, second = (read_result(f"{name}/biphasic-swelling.nc") for name in ("output/small", "again"))
    xr.testing.assert_equal(first, second)
    assert first.sizes["cell"] == 12


def test_existing_result_is_kept_unless_forced(case_file: Path) -> None:
    fvswell("run", case_file, "-q")
    path = Path("output/small/electrochemical.nc")
    before = path.read_bytes()
    refused = fvswell("run", case_file)
    assert refused.exit_code == 2
    assert refused.stdout == ""
    assert refused.stderr == f"error: {path}: exists already; use --force to replace it\n"
    assert path.read_bytes() == before
    assert fvswell("run", case_file, "--force", "-q").exit_code == 0


def test_all_mistakes_in_a_case_are_reported_and_nothing_is_written(case_file: Path) -> None:
    text = case_file.read_text().replace("youngs_modulus = 0.5", "youngs_modulus = -1.0\nporosity = 0.8")
    case_file.write_text(text)
    for command in ("run", "check", "compare"):
        done = fvswell(command, case_file)
        assert done.exit_code == 2
        assert done.stdout == ""
        lines = done.stderr.splitlines()
        assert len(lines) == 2
        assert all(line.startswith(f"error: {case_file}: tissue.") for line in lines)
    assert files() == {"small.toml"}


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["run", "none.toml"], "none.toml: no such file"),
        (["run", "none.nc"], "none.nc: no such file"),
        (["run", "smal.toml"], "did you mean small.toml?"),
        (["run", "small.toml", "--model", "triphasic"], 'must be one of "biphasic"'),
        (["run", "small.toml", "--set", "tissue.poison_ratio=0.2"], "did you mean poisson_ratio?"),
        (["run", "small.toml", "--set", "nonsense"], "must be key=value"),
        (["run", "small.toml", "-o", "small.toml"], "cannot be written"),
        (["compare", "small.toml", "--models", "biphasic"], "must be two or more"),
        (["compare", "small.toml", "--models", "biphasic,electric"], "must be one of"),
        (["plot", "none.nc"], "none.nc: no such file"),
        (["plot", "small.toml"], "is not a netCDF file"),
        (["info", "small.toml"], "is not a netCDF file"),
        (["new", "there/not/case"], "cannot be written"),
        (["run"], "Missing argument"),
        (["walk"], "No such command"),
        (["run", "small.toml", "--modle", "biphasic"], "No such option"),
    ],
)
def test_mistakes_end_with_2_and_a_message(case_file: Path, arguments: list[str], reported: str) -> None:
    done = fvswell(*arguments)
    assert done.exit_code == 2
    assert reported in done.stderr
    assert "Traceback" not in done.stderr
    assert files() == {"small.toml"}


def test_all_wrong_settings_are_reported_at_once(case_file: Path) -> None:
    done = fvswell("run", case_file, "--set", "a", "--set", "=b")
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 2


def test_stopped_run_keeps_its_result_and_says_where(tmp_path: Path) -> None:
    Path("hard.toml").write_text(impossible_compression().to_toml(), encoding="utf-8")
    done = fvswell("run", "hard.toml")
    assert done.exit_code == 3
    assert re.search(
        r"error: .*stopped at t = \S+ s in phase loading: the tissue would be inverted or without water", done.stderr
    )
    assert "output/hard/biphasic.nc: holds the result until then" in done.stderr
    assert "output/hard/biphasic.nc" in done.stdout
    assert "unloading" in done.stdout
    reported = fvswell("info", "output/hard/biphasic.nc")
    assert reported.exit_code == 0
    assert "stopped at t = " in reported.stdout
    assert "partial result" in reported.stdout
    assert fvswell("plot", "output/hard/biphasic.nc").exit_code == 0


def test_phase_that_does_not_relax_ends_with_3(case_file: Path) -> None:
    done = fvswell(
        "run", case_file, "--set", "phase.loading.duration=1 relaxation times",
        "--set", "phase.loading.piston.pressure=0",
    )  # fmt: skip
    assert done.exit_code == 3
    assert "give its duration in s" in done.stderr
    assert files() == {"small.toml"}


def test_lack_of_memory_ends_with_3_and_leaves_nothing(case_file: Path) -> None:
    done = fvswell("run", case_file, "--set", "output.per_phase=10000000000000")
    assert done.exit_code == 3
    assert done.stderr == "error: out of memory: fewer cells, steps or output times need less\n"
    assert files() == {"small.toml"}


def test_interrupted_run_ends_with_130_and_can_be_resumed(case_file: Path) -> None:
    steps = ["--set", "time.steps_per_phase=200000", "--set", "output.times=[1, 600]"]
    process = subprocess.Popen(
        [*COMMAND, "run", "small.toml", *steps],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # background jobs inherit it ignored
    )  # fmt: skip
    result, part = Path("output/small/electrochemical.nc"), Path("output/small/electrochemical.nc.part")
    deadline = time.monotonic() + 120.0
    while not part.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, message = process.communicate(timeout=60)
    assert process.returncode == 130
    assert message == "interrupted: what there is is kept, and the same command with --resume goes on\n"
    assert files() == {"small.toml", str(result)}
    assert read_result(result).attrs["run_status"].startswith("interrupted after t = ")
    done = fvswell("run", case_file, *steps, "--resume", "-q")
    assert done.exit_code == 0, done.stderr
    assert files() == {"small.toml", str(result)}
    assert read_result(result).attrs["run_status"] == "complete"


def test_run_starts_from_the_end_of_another(case_file: Path) -> None:
    assert fvswell("run", case_file, "-q", "-o", "first").exit_code == 0
    first = Path("first/electrochemical.nc")
    assert fvswell("run", case_file, "-q", "--from", first).exit_code == 0
    ended, started = (read_result(path)["volume_ratio"].values for path in (first, "output/small/electrochemical.nc"))
    np.testing.assert_array_equal(started[0], ended[-1])
    refused = fvswell("run", case_file, "-o", "third", "--from", first, "--set", "tissue.poisson_ratio=0.2")
    assert refused.exit_code == 2
    assert "tissue" in refused.stderr


def test_terminal_gets_a_progress_line_and_drawn_tables(case_file: Path) -> None:
    leader, follower = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "120"}
    process = subprocess.Popen(
        [*COMMAND, "run", "small.toml", "--set", "time.steps_per_phase=60"],
        stdout=follower, stderr=follower, env=environment,
    )  # fmt: skip
    os.close(follower)
    shown = b""
    while True:
        try:
            shown += os.read(leader, 65536)
        except OSError:  # the other end is closed
            break
    os.close(leader)
    assert process.wait() == 0
    text = shown.decode()
    assert re.search(r"t = \S+ of 600 s, strain -\d", text)
    assert "┃" in text
    assert "wrote output/small/electrochemical.nc" in text
    assert "% , t" not in text


def test_new_case_is_valid_and_not_overwritten() -> None:
    assert fvswell("new", "mine").exit_code == 0
    assert fvswell("check", "mine.toml").exit_code == 0
    Path("mine.toml").write_text("precious")
    refused = fvswell("new", "mine.toml")
    assert refused.exit_code == 2
    assert "use --force" in refused.stderr
    assert Path("mine.toml").read_text() == "precious"
    assert fvswell("new", "mine", "--force").exit_code == 0
    assert load_case("mine.toml").model == "electrochemical"


def test_new_case_of_a_tissue_and_its_laws_on_a_sheet() -> None:
    assert fvswell("new", "mine", "--tissue", "nucleus-pulposus").exit_code == 0
    assert load_case("mine.toml").tissue.shear_modulus == 1.0
    wrong = fvswell("new", "other", "--tissue", "nucleus")
    assert wrong.exit_code == 2
    assert "did you mean nucleus-pulposus?" in wrong.stderr
    assert fvswell("show", "mine.toml").exit_code == 0
    assert Path("output/mine/tissue.png").stat().st_size > 10_000
    assert fvswell("show", "mine.toml").exit_code == 2
    assert fvswell("show", "mine.toml", "-o", "laws.pdf", "--set", "tissue.fluid_fraction=0.7").exit_code == 0


def test_check_shows_derived_numbers() -> None:
    done = fvswell("check", CASES / "confined_compression.toml")
    assert done.exit_code == 0
    for number in ("1.054503", "-21.990 %", "-31.725 %", "k_open/k = 0.8394"):
        assert number in done.stdout
    assert "is valid" in done.stdout
    assert not files()


def test_check_shows_the_sample_in_both_states() -> None:
    """Given of the equilibrated sample, the numbers stand in its row, and those of the other are found."""
    changes = ("--set", "tissue.osmotic=activity", "--set", "tissue.reference_state=equilibrated")
    lines = fvswell("check", CASES / "confined_compression.toml", *changes).stdout.splitlines()
    free, swollen = (next(line.split() for line in lines if line.startswith(name)) for name in ("stress-f", "equilib"))
    assert swollen == ["equilibrated", "0.5", "0.80000", "0.2", "M", "0.001"]
    assert float(free[1]) == pytest.approx(0.5 / 1.17041, rel=1e-5)
    assert float(free[2]) == pytest.approx(1.0 - 0.2 * 1.17041, abs=2e-5)


def test_warnings_are_printed_and_fail_with_strict() -> None:
    weak = ("--set", "tissue.fixed_charge_density=0.1 M", "--set", "phase.loading.duration=60")
    done = fvswell("check", CASES / "confined_compression.toml", *weak)
    assert done.exit_code == 0
    assert "warning: " in done.stderr
    assert "pi - pi_bath is -0.0362 MPa" in done.stderr
    assert fvswell("check", CASES / "confined_compression.toml", *weak, "--strict").exit_code == 2
    assert fvswell("check", CASES / "confined_compression.toml", "--strict").exit_code == 0
    assert "pi - pi_bath" in fvswell("run", CASES / "confined_compression.toml", *weak, "-q").stderr
    assert "pi - pi_bath" in fvswell("advise", CASES / "confined_compression.toml", *weak).stderr


def test_check_echoes_profiles_and_ramps() -> None:
    done = fvswell(
        "check", CASES / "confined_compression.toml",
        "--set", 'tissue.fixed_charge_density={depth = [0, 0.5], value = ["0.1 M", "0.3 M"]}',
        "--set", 'phase.loading.piston.pressure={ramp_to = "0.1 MPa", over = "50 s"}',
    )  # fmt: skip
    assert "fixed charge density 0.1 M to 0.3 M over the depth" in done.stdout
    assert "piston pressure to 0.1 MPa within 50 s" in done.stdout


def test_compare_writes_results_table_and_figures(case_file: Path) -> None:
    done = fvswell("compare", case_file)
    assert done.exit_code == 0
    names = {f"{model}.nc" for model in MODELS} | {f"comparison.{suffix}" for suffix in ("csv", "png", "pdf")}
    assert files() == {"small.toml"} | {f"output/small/{name}" for name in names}
    assert done.stdout.count("R^2") == 2
    assert "electrochemical (reference)" in done.stdout
    refused = fvswell("compare", case_file, "--models", "biphasic,electrochemical")
    assert refused.exit_code == 2
    assert len(refused.stderr.splitlines()) == 5


def test_compare_computes_nothing_if_a_file_is_in_the_way(case_file: Path) -> None:
    Path("there").mkdir()
    Path("there/comparison.csv").write_text("precious")
    done = fvswell("compare", case_file, "-o", "there")
    assert done.exit_code == 2
    assert files() == {"small.toml", "there/comparison.csv"}


def test_plot_of_results(case_file: Path) -> None:
    fvswell("compare", case_file, "-q", "--models", "biphasic,electrochemical")
    results = [f"output/small/{model}.nc" for model in ("biphasic", "electrochemical")]
    assert fvswell("plot", results[0]).stdout == "wrote output/small/biphasic.png\n"
    done = fvswell("plot", *results, "-o", "f.pdf", "--times", "40 s,3 min", "--variable", "water_flux")
    assert done.exit_code == 0
    assert Path("f.pdf").read_bytes().startswith(b"%PDF")
    for wrong in (["-o", "f.txt"], ["--times", "soon"], ["--variable", "fluid_presure"]):
        refused = fvswell("plot", *results, *wrong)
        assert refused.exit_code == 2
        assert refused.stderr.startswith("error: ")
    assert not Path("f.txt").exists()


def test_info_shows_what_is_in_a_result(case_file: Path) -> None:
    fvswell("run", case_file, "-q")
    reported = fvswell("info", "output/small/electrochemical.nc").stdout
    for part in ("status    complete", "17 from 0 to 600 s", "10 cell", "fluid_pressure", "N mm-2", "fipy", "anion "):
        assert part in reported


def test_title_in_any_script_is_printed_anywhere(case_file: Path) -> None:
    environment = os.environ | {"PYTHONIOENCODING": "latin-1"}
    done = subprocess.run(
        [*COMMAND, "run", "small.toml", "--set", "title=[bold] Knorpel – 軟骨"],
        capture_output=True, env=environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"[bold] Knorpel ? ??")

"""Which parameters decide how well the biphasic-swelling model stands in for the electrochemical one: Sobol indices.

They share out the variance of log10(1 - R^2), the misfit in decades: R^2 itself ranges from nearly 1 to far below 0,
and its variance would be that of the worst corners only. The first index of a parameter is the share of the variance
that it explains by itself, the total index the share that is left when all others are known (Saltelli et al. 2010).
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from fvswell.case.case import Case, CaseError, load_case
from fvswell.case.errors import Problem
from fvswell.case.toml_file import file_text, toml_content
from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.prediction.case_prediction import predict_cases
from fvswell.study.batches import plan
from fvswell.study.designs import on_range
from fvswell.study.points import PAPER_MODELS
from fvswell.study.runs import Runs
from fvswell.study.scheduling import available_cores, in_this_process, on_cores
from fvswell.study.study import Study, load_study

__all__ = ["Sensitivity", "SobolIndices", "ranges_about", "read_ranges", "sensitivity"]

_SEED = 2005
_CONFIDENCE = 0.95
_VARIED = (
    "youngs_modulus", "hydraulic_permeability", "cation_diffusivity", "anion_diffusivity", "fixed_charge_density",
    "hindrance_factor",
)  # fmt: skip
Report = Callable[[str, int, int], None]

_LEAST_MISFIT = 1e-12  # 1 - R^2 is not known better


@dataclass(frozen=True)
class SobolIndices:
    """Indices of every parameter in every phase, ``(parameters, phases)``, each with half of its 95 % interval."""

    evaluations: int
    mean: Array  # of log10(1 - R^2), (phases,)
    deviation: Array  # its standard deviation, (phases,)
    first: Array
    first_confidence: Array
    total: Array
    total_confidence: Array


@dataclass(frozen=True)
class Sensitivity:
    """Indices for one protocol, by the predictor and by the models themselves."""

    protocol: str
    parameters: tuple[str, ...]
    phases: tuple[str, ...]
    predictor: SobolIndices
    models: SobolIndices | None


def read_ranges(path: Path, spread: float) -> Study:
    """The study of a file, or the ranges about a case; which of them a file is shows in its tables.

    Raises
    ------
    CaseError
        If the file cannot be read, or with all that is wrong with it.
    """
    content = toml_content(file_text(path), str(path))
    return load_study(path) if "protocol" in content else ranges_about(load_case(path), spread)


def ranges_about(case: Case, spread: float) -> Study:
    """A study that varies what a case gives as a number, from its value over ``spread`` to ``spread`` times it.

    Varied are properties of the tissue, loads and baths; phases with the same load or bath keep having the same.

    Raises
    ------
    CaseError
        If nothing can be varied, or a value in the range is not allowed.
    """
    content = tomllib.loads(case.to_toml())
    varied = {name: ([f"tissue.{name}"], content["tissue"].get(name)) for name in _VARIED}
    loads = {("bath_concentration", case.bath.concentration): ["bath.concentration"]}
    for phase in content["phase"]:
        parts = {key: own for key, own in phase.items() if isinstance(own, Mapping) and key != "bath_concentration"}
        given = {f"{part}.{kind}": load for part, own in parts.items() for kind, load in own.items()}
        for name, load in {**phase, **given}.items():
            if isinstance(load, float) and name != "duration":
                loads.setdefault((name, load), []).append(f"phase.{phase['name']}.{name}")
    for (name, value), keys in loads.items():
        _, phase_name, *rest = keys[0].split(".")
        quantity = name.replace(".", "_")
        varied[f"{quantity}_in_{re.sub(r'[^A-Za-z0-9]', '_', phase_name)}" if rest else quantity] = keys, value
    study = {
        "title": case.title,
        "parameter": [
            {"name": name, "key": keys, **_range(name, value, spread)}
            for name, (keys, value) in varied.items()
            if isinstance(value, float) and value > 0.0
        ],
        "design": [{"name": "one point", "kind": "combinations", "count": 1, "sampling": "random"}],
        "protocol": [{"name": Path(case.source).stem, "case": content}],
    }
    return Study.from_toml(tomli_w.dumps(study), case.source)


def sensitivity(
    study: Study,
    samples: int,
    model_samples: int = 0,
    processes: int | None = None,
    report: Report | None = None,
) -> list[Sensitivity]:
    """Sobol indices of the misfit for each protocol of a study, over the ranges of its parameters.

    The designs of the study are not used.

    Parameters
    ----------
    study
        Protocols, parameters and ranges.
    samples
        Base sample of the predictor, a power of two; it is evaluated ``samples`` times (parameters + 2).
    model_samples
        The same for the models themselves; 0 leaves them out.
    processes
        Number of processes for the models; one for each core without it. With 1, this process does the work.
    report
        Called with the protocol and how many of its model runs are done, of how many.

    Raises
    ------
    CaseError
        If the study is not of biphasic-swelling by electrochemical, a case cannot be predicted, or a parameter set
        cannot be.
    OutputError
        If SALib is not installed, or too few runs have a result.
    """
    if study.models != PAPER_MODELS:
        raise CaseError(
            [Problem("model", "", f"must be a study of {PAPER_MODELS[0]} by {PAPER_MODELS[1]}")], study.source
        )
    return [
        _of_protocol(study, protocol, samples, model_samples, processes or available_cores(), report)
        for protocol in range(len(study.cases))
    ]


def _of_protocol(
    study: Study, protocol: int, samples: int, model_samples: int, processes: int, report: Report | None
) -> Sensitivity:
    name = study.table.protocol[protocol].name
    varied = [i for i, p in enumerate(study.table.parameter) if p.protocols is None or name in p.protocols]
    sampled = _sampled(study, protocol, varied, samples)
    predicted = _indices(predict_cases(_cases(sampled)).r_squared, len(varied))
    models = None
    if model_samples:
        sampled = _sampled(study, protocol, varied, model_samples)
        _cases(sampled)  # all of them have to be possible
        models = _indices(_simulated(sampled, name, processes, report), len(varied))
    names = tuple(study.table.parameter[i].name for i in varied)
    return Sensitivity(name, names, study.phases, predicted, models)


def _problem(parameters: int) -> dict[str, Any]:
    """What SALib calls a problem: the unit cube."""
    return {
        "num_vars": parameters, "names": [str(i) for i in range(parameters)], "bounds": [[0.0, 1.0]] * parameters,
    }  # fmt: skip


def _sampled(study: Study, protocol: int, varied: Sequence[int], samples: int) -> Study:
    """The study with Saltelli's sample of one protocol for its runs."""
    try:
        from SALib.sample import sobol
    except ImportError:
        raise OutputError('Sobol indices need the extra "study": pip install "fvswell[study]"') from None
    unit = sobol.sample(_problem(len(varied)), samples, calc_second_order=False, seed=_SEED)
    values = np.full((len(unit), len(study.table.parameter)), np.nan)
    for column, i in enumerate(varied):
        parameter = study.table.parameter[i]
        values[:, i] = on_range(unit[:, column], parameter.low, parameter.high, parameter.spacing)
    rows = len(unit)
    runs = Runs(np.full(rows, protocol), np.zeros(rows, dtype=int), values)
    return replace(study, runs=runs, impossible={})


def _cases(study: Study) -> list[Case]:
    cases = []
    for run in range(len(study.runs)):
        try:
            cases.append(study.case(run))
        except CaseError as error:
            advice = Problem("", "", "every point of the ranges has to be possible: narrow them")
            raise CaseError([*error.problems, advice], study.source) from None
    return cases


def _simulated(study: Study, name: str, processes: int, report: Report | None) -> Array:
    """R^2 of every run, ``(runs, phases)``; nan where a run failed."""
    batches = plan(study)
    r_squared = np.full((len(study.runs), len(study.phases)), np.nan)
    done = 0
    with closing(in_this_process(batches) if processes == 1 else on_cores(batches, processes)) as finished:
        for index, result in finished:
            own = list(batches[index].runs)
            r_squared[own] = result["r_squared"]
            done += len(own)
            if report is not None:
                report(name, done, len(study.runs))
    return r_squared


def _indices(r_squared: Array, parameters: int) -> SobolIndices:
    """Indices from R^2 at the points of a sample; a base point with a failure among its points is left out."""
    from SALib.analyze import sobol

    blocks = r_squared.reshape(-1, parameters + 2, r_squared.shape[-1])
    blocks = blocks[np.isfinite(blocks).all(axis=(1, 2))]
    if len(blocks) < 2:
        raise OutputError("too few runs have a result: no sensitivity can be found")
    misfit = np.log10(np.maximum(1.0 - blocks.reshape(-1, r_squared.shape[-1]), _LEAST_MISFIT))
    found = [
        sobol.analyze(_problem(parameters), column, calc_second_order=False, conf_level=_CONFIDENCE, seed=_SEED)
        for column in misfit.T
    ]
    first, first_confidence, total, total_confidence = (
        np.stack([each[key] for each in found], axis=1) for key in ("S1", "S1_conf", "ST", "ST_conf")
    )
    return SobolIndices(
        len(misfit), misfit.mean(axis=0), misfit.std(axis=0), first, first_confidence, total, total_confidence
    )


def _range(name: str, value: float, spread: float) -> dict[str, Any]:
    high = min(value * spread, 1.0) if name == "hindrance_factor" else value * spread
    return {"low": value / spread, "high": high, "spacing": "log"}

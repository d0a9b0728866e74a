"""The runs of a study: every design, in each of its protocols."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.physics.tissue import Array
from fvswell.study.designs import combinations, full_grid, on_range, one_at_a_time
from fvswell.study.schema import Design, Grid, OneAtATime, Protocol, StudyTable, Variation

__all__ = ["Runs", "expand", "parameters_of", "protocols_of"]


@dataclass(frozen=True)
class Runs:
    """Parameter sets in the order of the result."""

    protocol: Array  # (runs,), index
    design: Array  # (runs,), index
    values: Array  # (runs, parameters), internal units; nan where a parameter stays as in the case

    def __len__(self) -> int:
        return len(self.protocol)


def protocols_of(table: StudyTable, design: Design) -> list[int]:
    """Indices of the protocols that a design runs."""
    return [
        i for i, protocol in enumerate(table.protocol) if design.protocols is None or protocol.name in design.protocols
    ]


def parameters_of(table: StudyTable, design: Variation, protocol: Protocol) -> list[int]:
    """Indices of the parameters that a design varies in a protocol."""
    names = tuple(design.counts) if isinstance(design, Grid) else design.parameters
    return [
        i
        for i, parameter in enumerate(table.parameter)
        if (names is None or parameter.name in names)
        and (parameter.protocols is None or protocol.name in parameter.protocols)
    ]


def expand(table: StudyTable) -> Runs:
    """All runs of a study, design by design and in each protocol by protocol."""
    protocols, designs, values = [], [], []
    for d, design in enumerate(table.design):
        for p in protocols_of(table, design):
            varied = parameters_of(table, design, table.protocol[p])
            unit = _points(table, design, varied)
            block = np.full((len(unit), len(table.parameter)), np.nan)
            for column, i in enumerate(varied):
                parameter = table.parameter[i]
                block[:, i] = on_range(unit[:, column], parameter.low, parameter.high, parameter.spacing)
            values.append(block)
            protocols.append(np.full(len(unit), p))
            designs.append(np.full(len(unit), d))
    return Runs(np.concatenate(protocols), np.concatenate(designs), np.concatenate(values))


def _points(table: StudyTable, design: Variation, varied: list[int]) -> Array:
    """Points of a design in the unit cube of the parameters it varies."""
    if isinstance(design, OneAtATime):
        return one_at_a_time(len(varied), design.count)
    if isinstance(design, Grid):
        return full_grid([design.counts[table.parameter[i].name] for i in varied])
    return combinations(len(varied), design.count, design.sampling, design.seed)

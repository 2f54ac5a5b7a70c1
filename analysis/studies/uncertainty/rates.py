"""Rates of a campaign's conclusions on each robot, and whether they depend on what nobody knows
of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import severity
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report.data import facts as run_facts
from ravenjax.robots.raven2.layers import LAYERS
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison.clustered import exchange_p
from ravenjax.stats.inputs.association import Dependence, dependences
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.multiplicity import Finding, holm
from ravenjax.store import folder, manifest
from studies.framework import kinds
from studies.framework.kinds import difference
from studies.uncertainty.parameters import Uncertain

EVENTS = {
    "evaded": "evades the checks: unintended motion, and nobody is told",
    "cue": "the cue fires",
    "stopped": "a check stops the robot",
    "unintended": f"unintended motion of more than {LIMIT_MM:g} mm",
    "unwarned": "unintended motion before the cue, or without one",
    "loss": "loss of motion",
    "misreport": "false report",
    "jump": "jump of the reported tip",
    "injury": "injury-capable motion",
}
"""What is concluded of a fault; each is a rate over the faults that changed a bit."""


FAULT = "fault"


class RobotRates(NamedTuple):
    """One robot under the same faults as every other."""

    name: str
    events: (
        pd.DataFrame
    )  # bool [faults], columns EVENTS, and `kind` and `layer`; index: number of the fault

    @property
    def faults(self) -> Units:
        """Kinds of the faults."""
        return units.units(self.events["kind"].to_numpy())

    def rate(self, event: str) -> Rate:
        """Share of the faults with that event, its interval over kinds of faults."""
        return units.rate(self.events[event].to_numpy(), self.faults)

    def where(self, layer: str) -> RobotRates:
        """Faults of one layer."""
        return self._replace(events=self.events.loc[self.events["layer"] == layer])


class ParameterEffect(NamedTuple):
    """An event at the ends of one parameter, all else alike."""

    event: str
    parameter: Uncertain
    low: Rate
    high: Rate
    difference: Estimate  # high minus low, fraction, of pairs; its interval over kinds of faults
    p: float  # exact, both ends exchanged kind by kind


def read(path: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Result table and events of a folder: runs with a fault that changed a bit, and a valid
    outcome.

    The table has a column more, `fault`: which of the campaign's faults it is, the same number in
    every variant.
    """
    frame, header = folder.read_all(path), manifest.read(path)
    frame[FAULT] = numbered(frame["pair"].to_numpy())
    facts = run_facts.of(frame, header)
    mask = facts["activated"] & facts["faulty"] & ~facts["failed"]
    return frame.loc[mask], events(frame.loc[mask], facts.loc[mask])


def numbered(pair: np.ndarray) -> np.ndarray:
    """Faults by their order in the campaign, from 0, of the column `pair`: runs of one fault
    share a number.
    """
    return np.unique(pair, return_inverse=True)[1]


def events(frame: pd.DataFrame, facts: pd.DataFrame) -> pd.DataFrame:
    """EVENTS of each run, its `layer` and the `kind` of its fault."""
    warned = (facts["warned_ms"] >= 0) & (facts["warned_ms"] < facts["unintended_ms"])
    return pd.DataFrame(
        {
            "evaded": facts["evaded"],
            "cue": facts["cued"],
            "stopped": facts["response"] == "stopped",
            "unintended": facts["unintended"],
            "unwarned": facts["unintended"] & ~warned,
            "loss": facts["loss"],
            "misreport": facts["misreport"],
            "jump": facts["jump"],
            "injury": severity.injury_capable(frame),
            "layer": facts["layer"],
            "kind": kinds.names(frame["group"]),
        }
    )


def robots(
    frame: pd.DataFrame, found: pd.DataFrame, parameter: Uncertain
) -> tuple[RobotRates, RobotRates]:
    """The robots at both ends of a parameter that was crossed, on faults that changed a bit in
    both.
    """
    values = parameter.values(frame)

    def at(value: float) -> pd.DataFrame:
        mine = np.isclose(values, value)
        return found.loc[mine].set_axis(pd.Index(frame.loc[mine, FAULT]))

    low, high = at(parameter.low), at(parameter.high)
    both = low.index.intersection(high.index)
    return (
        RobotRates(f"{parameter.words} {parameter.low:g}", low.loc[both]),
        RobotRates(f"{parameter.words} {parameter.high:g}", high.loc[both]),
    )


def effects(ends: Mapping[Uncertain, tuple[RobotRates, RobotRates]]) -> list[ParameterEffect]:
    """Of every event and parameter."""
    return [
        ParameterEffect(
            event,
            parameter,
            low.rate(event),
            high.rate(event),
            difference(high.events[event].to_numpy(), low.events[event].to_numpy(), low.faults),
            exchange_p(
                high.events[event].to_numpy(), low.events[event].to_numpy(), low.faults.unit
            ),
        )
        for event in EVENTS
        for parameter, (low, high) in ends.items()
    ]


def judged(p: Sequence[float]) -> list[Finding]:
    """Holm over all of them together."""
    return list(holm({str(k): one for k, one in enumerate(p)}).values())


def thirds(
    frame: pd.DataFrame, flags: pd.DataFrame, parameters: Sequence[Uncertain]
) -> list[tuple[str, Dependence]]:
    """Each event by thirds of each parameter, of robots all of whose parameters were drawn; p by
    Holm over all.
    """
    inputs = {one.path: one.values(frame) for one in parameters}
    tests = [
        (event, one) for event in EVENTS for one in dependences(flags[event].to_numpy(), inputs)
    ]
    findings = judged([one.p for _, one in tests])
    return [
        (event, one._replace(adjusted=finding.adjusted, depends=finding.rejected))
        for (event, one), finding in zip(tests, findings, strict=True)
    ]


def rounding(
    known: RobotRates, ends: Mapping[Uncertain, tuple[RobotRates, RobotRates]]
) -> tuple[float, int]:
    """Largest difference of a rate (fraction) between the known robot and ends that are the known
    robot, and how many such ends there are: what rounding alone decides, of runs at the edge of an
    event. NaN and 0 without such an end."""
    same = [
        robot
        for one, pair in ends.items()
        for robot, value in zip(pair, (one.low, one.high), strict=True)
        if value == one.nominal
    ]
    apart = []
    for robot in same:
        both = known.events.index.intersection(robot.events.index)
        for event in EVENTS:
            here, there = (part.events.loc[both, event].to_numpy(float) for part in (known, robot))
            apart.append(abs(float((here - there).mean())))
    return max(apart, default=math.nan), len(same)


class RateRange(NamedTuple):
    """Lowest and highest rate of an event over robots, and which robots have them."""

    low: Rate
    low_robot: str
    high: Rate
    high_robot: str


def over(listed: Sequence[RobotRates], event: str) -> RateRange:
    """Of one event."""
    rates = [(robot.rate(event), robot.name) for robot in listed]
    low, high = min(rates, key=lambda one: one[0].value), max(rates, key=lambda one: one[0].value)
    return RateRange(*low, *high)


def by_layer(listed: Sequence[RobotRates], event: str) -> dict[str, list[Rate]]:
    """Rate of an event by layer of the fault, one a robot, in the robot's order of layers."""
    rates = {}
    for name in LAYERS.values():
        parts = [robot.events.loc[robot.events["layer"] == name, event] for robot in listed]
        if all(len(part) for part in parts):
            rates[name] = [robot.where(name).rate(event) for robot in listed]
    return rates

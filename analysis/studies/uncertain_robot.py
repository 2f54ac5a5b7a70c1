"""Study: which conclusions depend on uncertain properties of the robot?

The same faults are run on robots that differ in properties that nobody knows exactly. The published
sets are eight hand-tuned descriptions of the same joints by the same authors, so their disagreement
measures the uncertainty. Where they agree or give no value, a range is an assumption and is marked
as one.
"""

from __future__ import annotations

import math
import tomllib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.analyses.search import runner
from ravenjax.analyses.search.file import loading
from ravenjax.campaign.file import bounds
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.report.data import facts as run_facts
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.declaration import LAYERS
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison.clustered import exchange_p
from ravenjax.stats.intervals import (
    Estimate,
    Rate,
    rate_difference,
    rates_with_intervals,
    share_of_cells,
)
from ravenjax.stats.multiplicity import Finding, holm_test
from ravenjax.store import folder, manifest
from studies import kinds
from studies.hazards import severity
from studies.kinds import difference
from studies.reacting_operator import rate
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    Variant,
    own_line,
    read_notes,
    study,
    table,
)


class Uncertain(NamedTuple):
    """One parameter of the robot that is not known exactly."""

    path: str  # name in a campaign
    words: str
    law: str  # distribution, in the form of a campaign file
    low: float  # ends of the range, at which it is varied alone
    high: float
    nominal: float  # value of the robot as it is known
    source: str

    @property
    def unit(self) -> str:
        """Return the unit from the robot's record."""
        return bounds.allowed_values(ROBOT, self.path)[0].unit

    @property
    def column(self) -> str:
        """Return the column of the result table."""
        return f"param:{self.path}"

    @property
    def drawn(self) -> str:
        """Return the override that draws it for each run."""
        return f"parameters.{self.path}={self.law}"

    @property
    def crossed(self) -> str:
        """Return the override that runs every fault at both ends."""
        return f"cross.{self.path}=[{self.low:g}, {self.high:g}]"

    def values(self, frame: pd.DataFrame) -> np.ndarray:
        """Return its value in each run of a result table."""
        nominal = pd.Series(self.nominal, frame.index)
        return (
            frame[self.column].fillna(self.nominal) if self.column in frame else nominal
        ).to_numpy(float)


PARAMETERS = (
    Uncertain(
        "plant.friction_scale",
        "friction",
        "{loguniform=[0.5, 2]}",
        0.5,
        2.0,
        1.0,
        "published sets: Coulomb friction of the motors 0.45 to 2 times the base (insertion to 5)",
    ),
    Uncertain(
        "plant.cable_stiffness_scale",
        "cable stiffness",
        "{loguniform=[0.5, 2]}",
        0.5,
        2.0,
        1.0,
        "published sets: elbow 1 to 3 times the base (here 2 is 1); the lower end, for worn cables,"
        " is assumed",
    ),
    Uncertain(
        "plant.cable_damping.shoulder",
        "cable damping, shoulder",
        "{loguniform=[1000, 4000]}",
        1000.0,
        4000.0,
        4000.0,
        "published sets: 0.25 to 1 times the base",
    ),
    Uncertain(
        "plant.cable_damping.elbow",
        "cable damping, elbow",
        "{loguniform=[1380, 4140]}",
        1380.0,
        4140.0,
        1380.0,
        "published sets: 1 to 3 times the base",
    ),
    Uncertain(
        "plant.cable_damping.insertion",
        "cable damping, insertion",
        "{loguniform=[400, 560]}",
        400.0,
        560.0,
        400.0,
        "published sets: 1 to 1.4 times the base",
    ),
    Uncertain(
        "plant.motor_constant_scale",
        "motor constant",
        "{uniform=[0.85, 1.15]}",
        0.85,
        1.15,
        1.0,
        "published torque a count 0.94 to 1 of this one, gains 0.8 to 1; widened to both sides by"
        " assumption",
    ),
    Uncertain(
        "plant.mass_scale",
        "mass of the links",
        "{uniform=[0.8, 1.2]}",
        0.8,
        1.2,
        1.0,
        "assumed: tools of different mass, masses from drawings",
    ),
    Uncertain(
        "usb.command_delay",
        "delay of a command",
        "{choice=[0, 1, 2, 3]}",
        0.0,
        3.0,
        0.0,
        "assumed: none as in the authors' simulator, to three frames of 1 ms of full-speed USB",
    ),
    Uncertain(
        "network.cycles_per_packet",
        "control cycles a packet",
        "{choice=[1, 2]}",
        1.0,
        2.0,
        1.0,
        "not told for the published experiments, 1 to 2; on a recorded robot two in 93 of 100",
    ),
    Uncertain(
        "plant.encoder_noise",
        "encoder noise",
        "{uniform=[0, 2]}",
        0.0,
        2.0,
        0.0,
        "assumed: up to two counts; quadrature encoders err by about one",
    ),
    Uncertain(
        "plant.torque_noise",
        "torque noise",
        "{uniform=[0, 0.01]}",
        0.0,
        0.01,
        0.0,
        "assumed: up to an eighth of the elbow motor's Coulomb friction",
    ),
    Uncertain(
        "plant.brakes.engage_ticks",
        "delay of the brakes",
        "{choice=[5, 10, 15, 25, 50]}",
        5.0,
        50.0,
        15.0,
        "assumed: power-off brakes of this size close within 5 to 50 ms",
    ),
)

SETS = parameter_sets.PUBLISHED
"""The published sets, with the authors' law of motor and cable."""


FEWEST_EXPECTED, TABLES_DRAWN = 5, 9999
"""Expected count below which the chi-squared distribution no longer holds (Cochran 1954), and
number of tables drawn then.
"""

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
"""Events of a fault. Each is a rate over the faults that changed a bit."""


FAULT_NUMBER = "fault"


class RobotRates(NamedTuple):
    """One robot under the same faults as every other."""

    name: str
    # bool [faults], columns EVENTS, and `kind` and `layer`; index: number of the fault.
    events: pd.DataFrame

    @property
    def faults(self) -> Units:
        """Return the kinds of the faults."""
        return units.group_units(self.events["kind"].to_numpy())

    def rate(self, event: str) -> Rate:
        """Return the share of faults with that event, with its interval over kinds of faults."""
        return units.rate_band(self.events[event].to_numpy(), self.faults)

    def where(self, layer: str) -> RobotRates:
        """Return the faults of one layer."""
        return self._replace(events=self.events.loc[self.events["layer"] == layer])


class ParameterEffect(NamedTuple):
    """An event at both ends of one parameter, with all other parameters equal."""

    event: str
    parameter: Uncertain
    low: Rate
    high: Rate
    # High minus low, fraction, over pairs; its interval is over kinds of faults.
    difference: Estimate
    p: float  # exact, both ends exchanged kind by kind


def read(path: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the result table and events of a folder, for runs with a valid outcome and a fault
    that changed a bit.

    The table has an additional column `fault`: the number of the campaign's fault, equal in every
    variant.
    """
    frame, header = folder.read_all(path), manifest.read_manifest(path)
    frame[FAULT_NUMBER] = numbered(frame["pair"].to_numpy())
    facts = run_facts.derive_from_manifest(frame, header)
    mask = facts["activated"] & facts["faulty"] & ~facts["failed"]
    return frame.loc[mask], events(frame.loc[mask], facts.loc[mask])


def numbered(pair: np.ndarray) -> np.ndarray:
    """Number faults by their order in the campaign, from 0, from the column `pair`. Runs of one
    fault share a number.
    """
    return np.unique(pair, return_inverse=True)[1]


def events(frame: pd.DataFrame, facts: pd.DataFrame) -> pd.DataFrame:
    """Return EVENTS of each run, its `layer` and the `kind` of its fault."""
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


def robots_at_ends(
    frame: pd.DataFrame, found: pd.DataFrame, parameter: Uncertain
) -> tuple[RobotRates, RobotRates]:
    """Return the robots at both ends of a crossed parameter, on faults that changed a bit
    in both.
    """
    values = parameter.values(frame)

    def at(value: float) -> pd.DataFrame:
        mine = np.isclose(values, value)
        return found.loc[mine].set_axis(pd.Index(frame.loc[mine, FAULT_NUMBER]))

    low, high = at(parameter.low), at(parameter.high)
    both = low.index.intersection(high.index)
    return (
        RobotRates(f"{parameter.words} {parameter.low:g}", low.loc[both]),
        RobotRates(f"{parameter.words} {parameter.high:g}", high.loc[both]),
    )


def parameter_effects(
    ends: Mapping[Uncertain, tuple[RobotRates, RobotRates]],
) -> list[ParameterEffect]:
    """Return the effect of every parameter on every event."""
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


def holm_findings(p: Sequence[float]) -> list[Finding]:
    """Apply Holm's adjustment over all of them."""
    return list(holm_test({str(k): one for k, one in enumerate(p)}).values())


class InputLevel(NamedTuple):
    """Runs of one level of an input: its name, and the input's least and greatest value there."""

    name: str
    least: float
    greatest: float
    rate: Rate


class Dependence(NamedTuple):
    """Whether a rate depends on one input.

    levels: the lowest, (middle) and highest third of the input. difference: rate in the last level
    minus rate in the first. p: of independence, NaN if the input or the outcome never varies.
    adjusted: by Holm over all inputs. depends: adjusted p is below 1 - confidence.
    """

    name: str
    n: int  # runs in which the input has a value
    p: float
    adjusted: float
    depends: bool
    levels: tuple[InputLevel, ...]
    difference: Estimate


def judge(measured: Sequence[Dependence], confidence: float) -> list[Dependence]:
    """Return the dependences with p adjusted for all of them, clearest first."""
    findings = holm_test({one.name: one.p for one in measured}, confidence)
    results = [
        one._replace(adjusted=findings[one.name].adjusted, depends=findings[one.name].rejected)
        for one in measured
    ]
    return sorted(results, key=lambda one: (np.isnan(one.p), one.p, -abs(one.difference.value)))


def thirds(values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return the level of each value [n] by its rank, int [n], and the levels' names.

    Equal values stay together, and each extreme has its own level.
    """
    from scipy.stats import rankdata

    if not len(values) or values.min() == values.max():
        return np.zeros(len(values), int), ["constant"]
    place = (rankdata(values) - 0.5) / len(values)
    low, high = (
        (place < 1 / 3) | (values == values.min()),
        (place > 2 / 3) | (values == values.max()),
    )
    return np.where(low, 0, np.where(high, 2, 1)), ["lowest third", "middle third", "highest third"]


def dependences_by_thirds(
    frame: pd.DataFrame, flags: pd.DataFrame, parameters: Sequence[Uncertain]
) -> list[tuple[str, Dependence]]:
    """Return each event by thirds of each parameter, for robots with all parameters drawn; p by
    Holm over all.
    """
    inputs = {one.path: one.values(frame) for one in parameters}
    tests = [
        (event, one) for event in EVENTS for one in dependences(flags[event].to_numpy(), inputs)
    ]
    findings = holm_findings([one.p for _, one in tests])
    return [
        (event, one._replace(adjusted=finding.adjusted, depends=finding.rejected))
        for (event, one), finding in zip(tests, findings, strict=True)
    ]


def dependences(
    hit: np.ndarray, inputs: Mapping[str, np.ndarray], confidence: float = 0.95, seed: int = 0
) -> list[Dependence]:
    """Return whether the rate of `hit` (bool [n]) depends on each numeric input [n], clearest
    first.

    Mann-Whitney's test detects a rate that rises or falls. The chi-squared test over thirds detects
    a rate that is worst at both ends or in the middle. p is twice the lesser (Bonferroni). If a
    third expects fewer than 5 hits or misses, the latter test uses tables drawn with `seed`. Runs
    are assumed to be independent. A run without a value (NaN) is left out for that input.
    """
    outcome = np.asarray(hit).astype(bool)
    measured = [
        _measured(name, outcome, np.asarray(values, float), confidence, seed)
        for name, values in inputs.items()
    ]
    return judge(measured, confidence)


def _measured(
    name: str, hit: np.ndarray, values: np.ndarray, confidence: float, seed: int
) -> Dependence:
    present = ~np.isnan(values)
    hit, values = hit[present], values[present]
    code, names = thirds(values)
    n = np.bincount(code, minlength=len(names))
    rate_of = rates_with_intervals(
        np.bincount(code, hit, minlength=len(names)).astype(int), n, confidence
    )
    levels = [
        InputLevel(label, values[code == i].min(), values[code == i].max(), rate)
        for i, (label, rate) in enumerate(zip(names, rate_of, strict=True))
        if rate.n
    ]
    p = _p(hit, code[:, None] == np.flatnonzero(n), values, seed)
    difference = Estimate(np.nan, np.nan, np.nan)
    if len(levels) > 1:
        first, last = levels[0].rate, levels[-1].rate
        difference = rate_difference(last.k, last.n, first.k, first.n, confidence)
    return Dependence(name, len(hit), p, p, False, tuple(levels), difference)


def _p(hit: np.ndarray, member: np.ndarray, values: np.ndarray, seed: int) -> float:
    """Return p of independence of hit [n] from its level (one-hot [n, levels]) and from the values
    [n].
    """
    from scipy.stats import MonteCarloMethod, chi2_contingency, mannwhitneyu
    from scipy.stats.contingency import expected_freq

    table = np.stack([member[hit].sum(axis=0), member[~hit].sum(axis=0)])
    if table.shape[1] < 2 or not table.sum(axis=1).all():
        return float("nan")
    sparse = expected_freq(table).min() < FEWEST_EXPECTED
    method = (
        MonteCarloMethod(n_resamples=TABLES_DRAWN, rng=np.random.default_rng(seed))
        if sparse
        else None
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        association: Any = chi2_contingency(table, correction=False, method=method)
    levels = float(association.pvalue)
    trend: Any = mannwhitneyu(values[hit], values[~hit])
    return min(1.0, 2 * min(levels, float(trend.pvalue)))


def rounding(
    known: RobotRates, ends: Mapping[Uncertain, tuple[RobotRates, RobotRates]]
) -> tuple[float, int]:
    """Return the largest difference of a rate (fraction) between the known robot and ends that
    equal the known robot, and their number.

    This is the effect of rounding alone, from runs at the edge of an event. Return NaN and 0
    without such an end.
    """
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
    """Lowest and highest rate of an event over robots, and the robots that have them."""

    low: Rate
    low_robot: str
    high: Rate
    high_robot: str


def over(listed: Sequence[RobotRates], event: str) -> RateRange:
    """Return the range for one event."""
    rates = [(robot.rate(event), robot.name) for robot in listed]
    low, high = min(rates, key=lambda one: one[0].value), max(rates, key=lambda one: one[0].value)
    return RateRange(*low, *high)


def rates_by_layer(listed: Sequence[RobotRates], event: str) -> dict[str, list[Rate]]:
    """Return the rate of an event by layer of the fault, one per robot, in the robot's order of
    layers.
    """
    rates = {}
    for name in LAYERS.values():
        parts = [robot.events.loc[robot.events["layer"] == name, event] for robot in listed]
        if all(len(part) for part in parts):
            rates[name] = [robot.where(name).rate(event) for robot in listed]
    return rates


OUTCOME = "peak_golden_deviation_mm"
SEARCHED_FAULT = {
    "site": "usb_out",
    "channel": ["shoulder", "elbow", "insertion"],
    "effect": "latch_offset",
    "value": 4000,
    "start_ms": 1000,
    "duration_ms": 32,
}
"""A fault that adds to the motor command after every check, held for 32 ms, on each positioning
joint.

Such a fault moves the instrument by its size and not by its duration.
"""
SEARCHES: dict[str, dict[str, Any]] = {
    "morris": {"kind": "morris", "trajectories": 60, "levels": 8},
    "sobol": {"kind": "sobol", "n": 128},
}


class Index(NamedTuple):
    """Indices of one parameter for one fault: value, and ends of the 95 % interval."""

    case: str  # joint that the fault acts on
    parameter: Uncertain
    mean_mm: float  # mean of the outcome over robots
    deviation_mm: float
    effect: tuple[float, float, float]  # Morris: mean |effect|, mm over the range
    spread: float  # Morris: standard deviation of the effect, mm
    total: tuple[float, float, float]  # Sobol: total index
    first: tuple[float, float, float]  # Sobol: first order
    runs: int  # runs of both methods


def find(out: Path, engine: str) -> list[Index]:
    """Run both searches into folders inside `out`, and return indices of every joint and parameter.
    Raises UserError.
    """
    records: dict[str, dict[str, Any]] = {}
    for name, search in SEARCHES.items():
        found = runner.run_search(loading.from_dict(_template(search)), out / name, engine).record[
            "result"
        ]
        records[name] = {
            "results": found["results"],
            "points": found["points"],
            "inputs": [one["name"] for one in found["inputs"]],
        }
    return indices(records)


def indices(records: Mapping[str, Mapping[str, Any]]) -> list[Index]:
    """Return the indices from the records of both searches, by joint in their order and by total
    index, greatest first.
    """
    by_path = {one.path: one for one in PARAMETERS}
    morris, sobol = records["morris"], records["sobol"]
    result = []
    for screen, shares in zip(morris["results"], sobol["results"], strict=True):
        if screen["indices"] is None or shares["indices"] is None:
            continue
        case = str(screen["case"]["fault0_channel"])
        mine = [
            Index(
                case,
                by_path[path],
                float(shares["mean"]),
                float(shares["deviation"]),
                _at(screen["indices"]["mu_star"], morris["inputs"].index(path)),
                float(screen["indices"]["sigma"]["value"][morris["inputs"].index(path)]),
                _at(shares["indices"]["ST"], place),
                _at(shares["indices"]["S1"], place),
                morris["points"] + sobol["points"],
            )
            for place, path in enumerate(sobol["inputs"])
        ]
        result += sorted(mine, key=lambda one: -one.total[0])
    return result


def _template(search: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "campaign": {
            "name": "uncertain_robot_search",
            "seed": 2016,
            "duration_s": 2.0,
            "noise": True,
        },
        "operator": {"motion": "suture", "scale": 0.1, "seed": 1},
        "parameters": drawn(PARAMETERS),
        "search": {**search, "outcomes": [OUTCOME]},
        "group": [{"name": "unchecked", "fault": [SEARCHED_FAULT]}],
    }


def drawn(parameters: Sequence[Uncertain]) -> dict[str, Any]:
    """Return a map from path to distribution, in the form of a campaign's table `parameters`."""
    return {one.path: tomllib.loads(f"law = {one.law}")["law"] for one in parameters}


def _at(index: Mapping[str, Sequence[float]], place: int) -> tuple[float, float, float]:
    value, low, high = (float(index[key][place]) for key in ("value", "low", "high"))
    return value, low, high


NONE = "none of those tried"


def parameter_table(listed: Sequence[Uncertain]) -> Table:
    """Return ranges and their sources."""
    return table(
        "What is not known of the robot",
        [
            {
                "parameter": one.words,
                "path": one.path,
                "range": f"{one.low:g} to {one.high:g}",
                "known robot": one.nominal,
                "unit": one.unit,
                "drawn": one.law,
                "where the range comes from": one.source,
            }
            for one in listed
        ],
    )


def conclusion_table(
    known: RobotRates,
    listed: Sequence[RobotRates],
    found: Sequence[ParameterEffect],
    drawn: Sequence[tuple[str, Dependence]],
    words: Mapping[str, str],
) -> Table:
    """Return each conclusion, its range over robots, and what it depends on. `words`: maps a path
    to the parameter in words.
    """
    judged = holm_findings([one.p for one in found])
    rows = []
    for event, words_of in EVENTS.items():
        span = over(listed, event)
        mine = [
            (one, finding)
            for one, finding in zip(found, judged, strict=True)
            if one.event == event and finding.rejected
        ]
        mine.sort(key=lambda item: -abs(item[0].difference.value))
        alone = [f"{one.parameter.words} ({signed(one.difference.value)})" for one, _ in mine]
        together = [words[one.name] for name, one in drawn if name == event and one.depends]
        rows.append(
            {
                "share of faults": words_of,
                "known robot": rate(known.rate(event)),
                f"lowest and highest of {len(listed)} robots": (
                    f"{percent(span.low)} to {percent(span.high)}"
                ),
                "on which robots": f"{span.low_robot}; {span.high_robot}",
                "depends on (same faults, one parameter from its low to its high end, points)": (
                    ", ".join(alone) or NONE
                ),
                "depends on (all drawn together, thirds)": ", ".join(together) or NONE,
            }
        )
    return table(
        "Which conclusions depend on the robot",
        rows,
        f"The {len(listed)} robots: the known one, each parameter at each end of its range, the"
        " published sets; the same faults on all. Depends: p below 0.05 after Holm over all"
        " conclusions and parameters of that column; on the same faults exact, both ends exchanged"
        " kind by kind; on drawn robots Mann-Whitney and chi-squared over thirds. That a"
        " conclusion is not seen to depend on a parameter is no proof: differences below some"
        f" points do not show among so many kinds of faults. {kinds.NOTE}",
    )


def ends_table(found: Sequence[ParameterEffect]) -> Table:
    """Return every rate at both ends of every parameter."""
    judged = holm_findings([one.p for one in found])
    return table(
        "One parameter at a time, the same faults",
        [
            {
                "share of faults": EVENTS[one.event],
                "parameter": (
                    f"{one.parameter.words}, {one.parameter.low:g} to {one.parameter.high:g}"
                ),
                "faults": one.low.n,
                "at the low end": rate(one.low),
                "at the high end": rate(one.high),
                "difference, points": points(one.difference),
                "p (Holm)": wording.format_number(finding.adjusted, 2),
            }
            for one, finding in zip(found, judged, strict=True)
        ],
        "Difference: high minus low end, pairs of the same fault and random numbers. p: both ends"
        " exchanged kind by kind, exact, Holm over the table; – where no fault came out"
        f" differently. {kinds.NOTE}",
    )


def thirds_table(drawn: Sequence[tuple[str, Dependence]], words: Mapping[str, str]) -> Table:
    """Return rates by thirds of each parameter."""
    rows = []
    for event, one in drawn:
        by_level = {
            level.name: rate(share_of_cells(level.rate.k, level.rate.n)) for level in one.levels
        }
        cells = [
            by_level.get(name, wording.DASH)
            for name in ("lowest third", "middle third", "highest third")
        ]
        rows.append(
            (
                EVENTS[event],
                words[one.name],
                *cells,
                points(one.difference),
                wording.format_number(one.adjusted, 2),
            )
        )
    return Table(
        "All parameters drawn together: rates by thirds",
        (
            "share of faults",
            "parameter",
            "lowest third",
            "middle third",
            "highest third",
            "highest minus lowest, points",
            "p (Holm)",
        ),
        tuple(rows),
        "Every run has its own fault and its own robot, whose parameters were drawn for it; of the"
        " difference, 95 %. p: twice the lesser of Mann-Whitney and chi-squared over thirds, Holm"
        " over the table. A parameter of few values has thirds of unequal size.",
    )


def layer_table(listed: Sequence[RobotRates], event: str) -> Table:
    """Return whether the order of layers depends on the robot."""
    rates_of = rates_by_layer(listed, event)
    places: dict[str, list[int]] = {name: [] for name in rates_of}
    for k in range(len(listed)):
        order = sorted(rates_of, key=lambda name: -rates_of[name][k].value)
        for name in rates_of:
            places[name].append(order.index(name) + 1)
    return table(
        f"Does the order of layers depend on the robot? Share of faults with: {EVENTS[event]}",
        [
            {
                "layer": name,
                "known robot, of the layer's faults": rate(rates[0]),
                f"lowest of {len(listed)} robots": percent(min(rates, key=lambda one: one.value)),
                "highest": percent(max(rates, key=lambda one: one.value)),
                "place on the known robot": places[name][0],
                "places on all robots": f"{min(places[name])} to {max(places[name])}",
            }
            for name, rates in rates_of.items()
        ],
        "Place 1 is the layer whose faults do it most often. The first robot is the known one."
        " Intervals as in the table before: none with fewer than 5 kinds of faults.",
    )


def sensitivity_table(found: Sequence[Index], outcome: str) -> Table:
    """Return the table of Morris and Sobol indices."""
    return table(
        "What decides how far an unchecked command throws the tip",
        [
            {
                "joint": one.case,
                "mean ± deviation over robots, mm": (
                    f"{wording.format_number(one.mean_mm)} ±"
                    f" {wording.format_number(one.deviation_mm, 2)}"
                ),
                "parameter": one.parameter.words,
                "Sobol, total": number(Estimate(*one.total)),
                "Sobol, first order": number(Estimate(*one.first)),
                "Morris, mean |effect|, mm": number(Estimate(*one.effect)),
                "Morris, deviation, mm": wording.format_number(one.spread, 2),
                "runs": one.runs,
            }
            for one in found
        ],
        f"`{outcome}` of 4000 counts added behind every check for 32 ms. Total: share of the"
        " variance over robots that the parameter causes, alone and together with others. Mean"
        " |effect|: change over the whole range. 95 %, bootstrap. First orders scatter about 0"
        " where there is nothing. Totals do not: every run draws its own noise, which no parameter"
        " explains and every total contains; the delay of the brakes, which close in none of these"
        " runs, shows how much.",
    )


# --- cells ---


def percent(found: Rate) -> str:
    """Write 12.3 %."""
    return wording.format_percent(found.value)


def points(difference: Estimate) -> str:
    """Write a difference of rates in points, with its interval."""
    return number(Estimate(*(100.0 * value for value in difference)))


def signed(difference: float) -> str:
    """Write a signed number: +1.2, in points."""
    text = wording.format_number(100.0 * difference, 2)
    return f"+{text}" if difference > 0 else text


def number(found: Estimate) -> str:
    """Write a number with its interval."""
    if math.isnan(found.value):
        return wording.DASH
    value, low, high = (wording.format_number(end + 0.0, 2) for end in found)
    return value if math.isnan(found.low) else f"{value} ({low} to {high})"


CAMPAIGN = "uncertain_robot.toml"
KNOWN = "known"
SEEDS = (1, 2, 3)
"""Seeds, each of a separate draw of faults and robots together."""
LAYER_EVENT = "unintended"
WORDS = {one.path: one.words for one in PARAMETERS}


def compare(context: Context) -> Findings:
    """Compare rates on every robot, with one parameter varied at a time and with all, and find what
    decides how far a fault moves the tip.
    """
    frame, flags = read(context.folders[KNOWN])
    base = RobotRates("known robot", flags.set_axis(pd.Index(frame[FAULT_NUMBER])))
    ends = {one: robots_at_ends(*read(context.folders[_alone(one)]), one) for one in PARAMETERS}
    sets = [_set(context, name) for name in SETS]
    robots = [base, *(robot for pair in ends.values() for robot in pair), *sets]
    effects = parameter_effects(ends)
    thirds = _thirds(context)
    decided = find(context.folders[KNOWN].parent.parent / "searches", context.engine)
    return Findings(
        lines=tuple(_lines(base, robots, effects)),
        tables=(
            conclusion_table(base, robots, effects, thirds, WORDS),
            layer_table(robots, LAYER_EVENT),
            parameter_table(PARAMETERS),
            ends_table(effects),
            thirds_table(thirds, WORDS),
            sensitivity_table(decided, OUTCOME),
        ),
        notes=_notes(len(robots), *rounding(base, ends)),
    )


def _alone(parameter: Uncertain) -> str:
    """Return the variant in which a parameter is at both ends."""
    return "alone_" + parameter.path.removeprefix("plant.").replace(".", "_")


def _set(context: Context, name: str) -> RobotRates:
    frame, flags = read(context.folders[f"set_{name}"])
    return RobotRates(f"set {name}", flags.set_axis(pd.Index(frame[FAULT_NUMBER])))


def _thirds(context: Context) -> list[tuple[str, Dependence]]:
    parts = [read(context.folders[f"drawn_{seed}"]) for seed in SEEDS]
    columns = [one.column for one in PARAMETERS]
    frame = pd.DataFrame(pd.concat([frame[columns] for frame, _ in parts], ignore_index=True))
    return dependences_by_thirds(
        frame, pd.concat([flags for _, flags in parts], ignore_index=True), PARAMETERS
    )


def _lines(
    known: RobotRates, robots: Sequence[RobotRates], effects: Sequence[ParameterEffect]
) -> Iterator[Line]:
    for event, words in EVENTS.items():
        rate = known.rate(event)
        of = f"faults of this design, {kinds.count(known.faults)}, the known robot"
        value = StudyEstimate(100 * rate.value, 100 * rate.low, 100 * rate.high, rate.n, of)
        yield own_line(words, "%", value)
        span = over(robots, event)
        many = StudyEstimate(
            100 * rate.value,
            100 * span.low.value,
            100 * span.high.value,
            len(robots),
            "robots, extremes",
        )
        yield own_line(f"{words}, over robots", "%", many)
    judged = holm_findings([one.p for one in effects])
    for parameter in PARAMETERS:
        depends = [
            f.rejected for one, f in zip(effects, judged, strict=True) if one.parameter == parameter
        ]
        value = StudyEstimate(sum(depends), n=len(EVENTS), of="conclusions")
        yield own_line(f"conclusions that depend on: {parameter.words}", "", value)


def _notes(robots: int, rounding: float, same: int) -> tuple[str, ...]:
    return read_notes("uncertain_robot", robots=robots, same=same, rounding=100 * rounding)


def _variants() -> Iterator[Variant]:
    yield Variant(KNOWN, CAMPAIGN)
    for one in PARAMETERS:
        yield Variant(
            _alone(one),
            CAMPAIGN,
            (one.crossed,),
            f"{one.words}: {one.low:g} or {one.high:g} {one.unit}".rstrip(),
        )
    for name in SETS:
        yield Variant(
            f"set_{name}",
            CAMPAIGN,
            (f"campaign.parameter_set={name}",),
            f"the published set {name}",
        )
    for seed in SEEDS:
        overrides = (f"campaign.seed={seed}", *(one.drawn for one in PARAMETERS))
        yield Variant(f"drawn_{seed}", CAMPAIGN, overrides, f"every run another robot, draw {seed}")


STUDY = study("uncertain_robot", variants=tuple(_variants()), compare=compare)

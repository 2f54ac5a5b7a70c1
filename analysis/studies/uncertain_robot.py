"""Study: which conclusions depend on uncertain properties of the robot?

The same faults are run on robots that differ in properties that nobody knows exactly. The published
sets are eight hand-tuned descriptions of the same joints by the same authors, so their disagreement
measures the uncertainty. Where they agree or give no value, a range is an assumption and is marked
as one.
"""

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
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.declaration import LAYERS
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.stats.bootstrap import units
from ravenjax.stats.comparison.clustered import exchange_p
from ravenjax.stats.intervals import Estimate, Rate, rate_difference, share_of_cells
from ravenjax.stats.multiplicity import Finding, holm_test
from studies import kinds, runs
from studies.kinds import difference
from studies.reacting_operator import rate
from studies.study import (
    HERE,
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    in_percent,
    own_line,
    read_notes,
    read_table,
    read_variants,
    study,
)

NAME = "uncertain_robot"


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

    def values(self, frame: pd.DataFrame) -> np.ndarray:
        """Return its value in each run of a result table."""
        nominal = pd.Series(self.nominal, frame.index)
        return (
            frame[self.column].fillna(self.nominal) if self.column in frame else nominal
        ).to_numpy(float)


PARAMETERS = tuple(
    Uncertain(**row)
    for row in tomllib.loads((HERE / "published" / f"{NAME}.toml").read_text())["parameter"]
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

    def rate(self, event: str) -> Rate:
        """Return the share of faults with that event, with its interval over kinds of faults."""
        return units.rate_band(
            self.events[event].to_numpy(), units.group_units(self.events["kind"].to_numpy())
        )


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
    """Return the runs of a folder with a valid outcome and a fault that changed a bit: its result
    table, and EVENTS of each run with the `layer` and `kind` of its fault.

    Both are indexed by the number of the campaign's fault, equal in every variant.
    """
    found = runs.read(path)
    # Runs of one fault share a pair.
    number = np.unique(found["pair"], return_inverse=True)[1]
    frame = found.frame.set_axis(pd.Index(number)).loc[runs.changed_a_bit(found)]
    warned = (frame["warned_ms"] >= 0) & (frame["warned_ms"] < frame["unintended_ms"])
    same = ["evaded", "unintended", "loss", "misreport", "jump", "injury"]
    return frame, frame[same].assign(
        cue=frame["cued"],
        stopped=frame["response"] == "stopped",
        unwarned=frame["unintended"] & ~warned,
        layer=frame["layer"],
        kind=kinds.names(frame["group"]),
    )


def robots_at_ends(
    frame: pd.DataFrame, found: pd.DataFrame, parameter: Uncertain
) -> tuple[RobotRates, RobotRates]:
    """Return the robots at both ends of a crossed parameter, on faults that changed a bit
    in both.
    """
    values = parameter.values(frame)
    low, high = (found.loc[np.isclose(values, end)] for end in (parameter.low, parameter.high))
    both = low.index.intersection(high.index)
    return (
        RobotRates(f"{parameter.words} {parameter.low:g}", low.loc[both]),
        RobotRates(f"{parameter.words} {parameter.high:g}", high.loc[both]),
    )


def parameter_effects(
    ends: Mapping[Uncertain, tuple[RobotRates, RobotRates]],
) -> list[ParameterEffect]:
    """Return the effect of every parameter on every event."""
    effects = []
    for event in EVENTS:
        for parameter, (low, high) in ends.items():
            among = units.group_units(low.events["kind"].to_numpy())
            above, below = (end.events[event].to_numpy() for end in (high, low))
            gap, p = difference(above, below, among), exchange_p(above, below, among.unit)
            effects.append(
                ParameterEffect(event, parameter, low.rate(event), high.rate(event), gap, p)
            )
    return effects


def holm_findings(p: Sequence[float]) -> list[Finding]:
    """Apply Holm's adjustment over all of them."""
    return list(holm_test({str(k): one for k, one in enumerate(p)}).values())


class Dependence(NamedTuple):
    """Whether the rate of an event depends on one parameter."""

    event: str
    parameter: Uncertain
    p: float  # of independence; NaN if the parameter or the event never varies
    levels: Mapping[str, Rate]  # the lowest, (middle) and highest third of the parameter
    difference: Estimate  # rate in the last level minus rate in the first


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


def dependences(
    frame: pd.DataFrame, flags: pd.DataFrame, parameters: Sequence[Uncertain]
) -> list[Dependence]:
    """Return whether each event depends on each parameter, for robots with all parameters drawn;
    of one event the clearest first.

    Mann-Whitney's test detects a rate that rises or falls. The chi-squared test over thirds detects
    a rate that is worst at both ends or in the middle. p is twice the lesser (Bonferroni). If a
    third expects fewer than 5 hits or misses, the latter test uses drawn tables. Runs are assumed
    to be independent.
    """
    found = []
    for event in EVENTS:
        hit = flags[event].to_numpy(bool)
        mine = [_dependence(event, one, hit, one.values(frame)) for one in parameters]
        found += sorted(mine, key=lambda one: (np.isnan(one.p), one.p, -abs(one.difference.value)))
    return found


def _dependence(
    event: str, parameter: Uncertain, hit: np.ndarray, values: np.ndarray
) -> Dependence:
    code, names = thirds(values)
    n = np.bincount(code, minlength=len(names))
    k = np.bincount(code, hit, minlength=len(names)).astype(int)
    levels = {name: share_of_cells(k[i], n[i]) for i, name in enumerate(names) if n[i]}
    gap = Estimate(np.nan, np.nan, np.nan)
    if len(levels) > 1:
        first, *_, last = levels.values()
        gap = rate_difference(last.k, last.n, first.k, first.n, 0.95)
    p = _p(hit, code[:, None] == np.flatnonzero(n), values)
    return Dependence(event, parameter, p, levels, gap)


def _p(hit: np.ndarray, member: np.ndarray, values: np.ndarray) -> float:
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
        MonteCarloMethod(n_resamples=TABLES_DRAWN, rng=np.random.default_rng(0)) if sparse else None
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


def extremes(listed: Sequence[RobotRates], event: str) -> tuple[tuple[Rate, str], tuple[Rate, str]]:
    """Return the lowest and the highest rate of an event over robots, each with its robot."""
    rates = [(robot.rate(event), robot.name) for robot in listed]
    return min(rates, key=lambda one: one[0].value), max(rates, key=lambda one: one[0].value)


def rates_by_layer(listed: Sequence[RobotRates], event: str) -> dict[str, list[Rate]]:
    """Return the rate of an event by layer of the fault, one per robot, in the robot's order of
    layers.
    """
    rates = {}
    for name in LAYERS.values():
        parts = [RobotRates("", one.events.loc[one.events["layer"] == name]) for one in listed]
        if all(len(part.events) for part in parts):
            rates[name] = [part.rate(event) for part in parts]
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
    """Run both searches into folders inside `out`, and return indices of every joint and parameter,
    by joint in their order and by total index, greatest first. Raises UserError.
    """
    morris, sobol = (
        runner.run_search(loading.from_dict(_template(search)), out / name, engine).record["result"]
        for name, search in SEARCHES.items()
    )
    by_path, result = {one.path: one for one in PARAMETERS}, []
    screened = [one["name"] for one in morris["inputs"]]
    for screen, shares in zip(morris["results"], sobol["results"], strict=True):
        if screen["indices"] is None or shares["indices"] is None:
            continue
        mine = []
        for number, path in enumerate(one["name"] for one in sobol["inputs"]):
            other = screened.index(path)
            mine.append(
                Index(
                    str(screen["case"]["fault0_channel"]),
                    by_path[path],
                    float(shares["mean"]),
                    float(shares["deviation"]),
                    _at(screen["indices"]["mu_star"], other),
                    float(screen["indices"]["sigma"]["value"][other]),
                    _at(shares["indices"]["ST"], number),
                    _at(shares["indices"]["S1"], number),
                    morris["points"] + sobol["points"],
                )
            )
        result += sorted(mine, key=lambda one: -one.total[0])
    return result


def _template(search: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "campaign": {
            "name": "uncertain_robot_search",
            "seed": 2016,
            "duration_s": 2.0,
            "noise": True,
            "packets": "measured",
        },
        "operator": {"motion": "suture", "scale": 0.1, "seed": 1},
        "parameters": {one.path: tomllib.loads(f"law = {one.law}")["law"] for one in PARAMETERS},
        "search": {**search, "outcomes": [OUTCOME]},
        "group": [{"name": "unchecked", "fault": [SEARCHED_FAULT]}],
    }


def _at(index: Mapping[str, Sequence[float]], place: int) -> tuple[float, float, float]:
    value, low, high = (float(index[key][place]) for key in ("value", "low", "high"))
    return value, low, high


NONE = "none of those tried"


def parameter_rows() -> Iterator[tuple[str, ...]]:
    """Yield ranges and their sources."""
    for one in PARAMETERS:
        span = f"{one.low:g} to {one.high:g}"
        yield one.words, one.path, span, one.nominal, one.unit, one.law, one.source


def conclusion_rows(
    known: RobotRates,
    listed: Sequence[RobotRates],
    found: Sequence[ParameterEffect],
    drawn: Sequence[Dependence],
) -> Iterator[tuple[str, ...]]:
    """Yield each conclusion, its range over robots, and what it depends on."""
    judged, judged_drawn = (holm_findings([one.p for one in part]) for part in (found, drawn))
    for event, words_of in EVENTS.items():
        (low, low_robot), (high, high_robot) = extremes(listed, event)
        mine = [
            one
            for one, finding in zip(found, judged, strict=True)
            if one.event == event and finding.rejected
        ]
        mine.sort(key=lambda one: -abs(one.difference.value))
        alone = [f"{one.parameter.words} ({signed(one.difference.value)})" for one in mine]
        together = [
            one.parameter.words
            for one, finding in zip(drawn, judged_drawn, strict=True)
            if one.event == event and finding.rejected
        ]
        yield (
            *(words_of, rate(known.rate(event)), f"{percent(low)} to {percent(high)}"),
            *(f"{low_robot}; {high_robot}", ", ".join(alone) or NONE, ", ".join(together) or NONE),
        )


def end_rows(found: Sequence[ParameterEffect]) -> Iterator[tuple[str | int, ...]]:
    """Yield every rate at both ends of every parameter."""
    for one, finding in zip(found, holm_findings([one.p for one in found]), strict=True):
        parameter = f"{one.parameter.words}, {one.parameter.low:g} to {one.parameter.high:g}"
        yield (
            *(EVENTS[one.event], parameter, one.low.n, rate(one.low), rate(one.high)),
            *(points(one.difference), wording.format_number(finding.adjusted, 2)),
        )


def third_rows(drawn: Sequence[Dependence]) -> Iterator[tuple[str, ...]]:
    """Yield rates by thirds of each parameter."""
    for one, finding in zip(drawn, holm_findings([one.p for one in drawn]), strict=True):
        cells = [
            rate(one.levels[name]) if name in one.levels else wording.DASH
            for name in ("lowest third", "middle third", "highest third")
        ]
        adjusted = wording.format_number(finding.adjusted, 2)
        words = EVENTS[one.event], one.parameter.words
        yield *words, *cells, points(one.difference), adjusted


def layer_rows(listed: Sequence[RobotRates], event: str) -> Iterator[tuple[str | int, ...]]:
    """Yield whether the order of layers depends on the robot."""
    rates_of = rates_by_layer(listed, event)
    places: dict[str, list[int]] = {name: [] for name in rates_of}
    for k in range(len(listed)):
        order = sorted(rates_of, key=lambda name: -rates_of[name][k].value)
        for name in rates_of:
            places[name].append(order.index(name) + 1)
    for name, rates in rates_of.items():
        low, high = (percent(end(rates, key=lambda one: one.value)) for end in (min, max))
        spread = f"{min(places[name])} to {max(places[name])}"
        yield name, rate(rates[0]), low, high, places[name][0], spread


def sensitivity_rows(found: Sequence[Index]) -> Iterator[tuple[str | int, ...]]:
    """Yield the Morris and Sobol indices."""
    for one in found:
        mean, deviation = (
            wording.format_number(one.mean_mm),
            wording.format_number(one.deviation_mm, 2),
        )
        indices = (number(Estimate(*index)) for index in (one.total, one.first, one.effect))
        spread = wording.format_number(one.spread, 2)
        yield one.case, f"{mean} ± {deviation}", one.parameter.words, *indices, spread, one.runs


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


KNOWN = "known"
SEEDS = (1, 2, 3)
"""Seeds, each of a separate draw of faults and robots together."""
LAYER_EVENT = "unintended"
EVERY_CYCLE = "length of packets 0"
"""Name of the robot that gets a packet in each control cycle."""


def compare(context: Context) -> Findings:
    """Compare rates on every robot, with one parameter varied at a time and with all, and find what
    decides how far a fault moves the tip.
    """
    folders = context.folders
    base = RobotRates("known robot", read(folders[KNOWN])[1])
    ends = {}
    for one in PARAMETERS:
        name = "alone_" + one.path.removeprefix("plant.").replace(".", "_")
        ends[one] = robots_at_ends(*read(folders[name]), one)
    sets = [RobotRates(f"set {name}", read(folders[f"set_{name}"])[1]) for name in SETS]
    robots = [base, *(robot for pair in ends.values() for robot in pair), *sets]
    effects = parameter_effects(ends)
    frames, flags = zip(*(read(folders[f"drawn_{seed}"]) for seed in SEEDS), strict=True)
    thirds = dependences(pd.concat(frames), pd.concat(flags), PARAMETERS)
    decided = find(folders[KNOWN].parent.parent / "searches", context.engine)
    count, event = len(robots), EVENTS[LAYER_EVENT]
    apart, same = rounding(base, ends)

    def table(key: str, rows: Iterator[tuple[Any, ...]], **values: Any) -> Table:
        return read_table(NAME, key, rows, **values)

    return Findings(
        lines=tuple(_lines(base, robots, effects)),
        tables=(
            table("conclusions", conclusion_rows(base, robots, effects, thirds), robots=count),
            table("layers", layer_rows(robots, LAYER_EVENT), robots=count, event=event),
            table("parameters", parameter_rows()),
            table("ends", end_rows(effects)),
            table("thirds", third_rows(thirds)),
            table("sensitivity", sensitivity_rows(decided), outcome=OUTCOME),
        ),
        notes=read_notes(NAME, robots=count, same=same, rounding=100 * apart),
    )


def _lines(
    known: RobotRates, robots: Sequence[RobotRates], effects: Sequence[ParameterEffect]
) -> Iterator[Line]:
    faults = kinds.count(units.group_units(known.events["kind"].to_numpy()))
    cycle = next(robot for robot in robots if robot.name == EVERY_CYCLE)
    for event, words in EVENTS.items():
        share, other = known.rate(event), cycle.rate(event)
        of = f"faults of this design, {faults}, the known robot"
        yield own_line(words, "%", in_percent(share, share.n, of))
        yield own_line(f"{words}, a packet each cycle", "%", in_percent(other, other.n, of))
        (low, _), (high, _) = extremes(robots, event)
        span = Estimate(share.value, low.value, high.value)
        value = in_percent(span, len(robots), "robots, extremes")
        yield own_line(f"{words}, over robots", "%", value)
    judged = holm_findings([one.p for one in effects])
    for parameter in PARAMETERS:
        depends = [
            f.rejected for one, f in zip(effects, judged, strict=True) if one.parameter == parameter
        ]
        value = StudyEstimate(sum(depends), n=len(EVENTS), of="conclusions")
        yield own_line(f"conclusions that depend on: {parameter.words}", "", value)


STUDY = study(NAME, variants=read_variants(NAME), compare=compare)

"""Study: which conclusions depend on uncertain properties of the robot?

The same faults run on robots that differ in uncertain parameters. The published parameter sets are
eight hand-tuned descriptions of the same joints, so their differences measure the uncertainty.
Where they agree or give no value, the range is an assumption and is marked.
"""

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
from ravenjax.report.wording import format_number, format_percent
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.declaration import LAYERS
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.stats import units
from ravenjax.stats.intervals import Estimate, Rate, rate_difference, share_of_cells
from ravenjax.stats.multiplicity import Finding, holm_test
from ravenjax.stats.paired import exchange_p
from studies import kinds, runs, study
from studies.cells import plain
from studies.kinds import difference
from studies.reacting_operator import rate
from studies.study import Cell, read_table

NAME, KNOWN, KNOWN_ROBOT = "uncertain_robot", "known", "known robot"
"""KNOWN: the variant of KNOWN_ROBOT."""
SEEDS = (1, 2, 3)
"""Seeds of separate draws of faults and robots."""
SETS = parameter_sets.PUBLISHED
"""The published sets, with the published law of motor and cable."""
FEWEST_EXPECTED, TABLES_DRAWN = 5, 9999
"""Least expected count for the chi-squared distribution (Cochran 1954), and tables drawn below."""
DATA = study.read_toml(f"published/{NAME}.toml")
EVENTS = {name: words.format(limit_mm=LIMIT_MM) for name, words in DATA["events"].items()}
"""Words of the events, by column of runs. Rates are over the faults that changed a bit."""
LAYER_EVENT = "unintended"
EVERY_CYCLE = "measured packet lengths 0"
"""Name of the robot that receives a packet in each control cycle."""
THIRDS = ("lowest third", "middle third", "highest third")


class Uncertain(NamedTuple):
    """One parameter of the robot that is not known exactly."""

    path: str  # name in a campaign
    words: str
    law: str  # distribution, in the form of a campaign file
    low: float  # ends of the range, at which it is varied alone
    high: float
    nominal: float  # value of the known robot
    source: str

    @property
    def column(self) -> str:
        """Return the column of the result table."""
        return f"param:{self.path}"

    @property
    def range(self) -> str:
        """Return the ends of the range in words."""
        return f"{self.low:g} to {self.high:g}"

    def values(self, frame: pd.DataFrame) -> np.ndarray:
        """Return the value in each run of a result table."""
        varied = frame.get(self.column, pd.Series(self.nominal, frame.index))
        return varied.fillna(self.nominal).to_numpy(float)


PARAMETERS = tuple(Uncertain(**row) for row in DATA["parameter"])
Robots = Mapping[str, pd.DataFrame]
"""Maps robots with the same faults to EVENTS of each fault, bool, and its `kind` and `layer`."""


class Dependence(NamedTuple):
    """Whether the rate of an event depends on one parameter."""

    event: str
    parameter: Uncertain
    # NaN without different outcomes. At both ends: exact test that exchanges them kind by kind. Of
    # drawn robots: test of independence.
    p: float
    levels: Mapping[str, Rate]  # at both ends, or in thirds of the parameter
    difference: Estimate  # rate in the last level minus rate in the first, fraction


def rate_of(events: pd.DataFrame, event: str) -> Rate:
    """Return the share of faults with an event, with its interval over kinds of faults."""
    return units.rate_band(events[event].to_numpy(), kinds_of(events))


def kinds_of(events: pd.DataFrame) -> units.Units:
    """Return the kinds of faults of one robot."""
    return units.group_units(events["kind"].to_numpy())


def read(path: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the runs whose fault changed a bit, and their EVENTS, indexed by the fault."""
    found = runs.read(path)
    # Runs of one fault share a pair.
    number = np.unique(found["pair"], return_inverse=True)[1]
    frame = found.frame.set_axis(pd.Index(number)).loc[runs.changed_a_bit(found)]
    return frame, frame[[*EVENTS, "layer"]].assign(kind=kinds.names(frame["group"]))


def robots_at_ends(path: Path, parameter: Uncertain) -> Robots:
    """Return the robots at both ends of a parameter, on faults that act in both."""
    frame, found = read(path)
    ends, values = (parameter.low, parameter.high), parameter.values(frame)
    low, high = (found.loc[np.isclose(values, end)] for end in ends)
    both = low.index.intersection(high.index)
    parts = zip(ends, (low, high), strict=True)
    return {f"{parameter.words} {end:g}": part.loc[both] for end, part in parts}


def parameter_effects(ends: Mapping[Uncertain, Robots]) -> list[Dependence]:
    """Return the effect of every parameter on every event, over pairs of the same fault."""
    effects = []
    for event in EVENTS:
        for parameter, robots in ends.items():
            low, high = robots.values()
            above, below, among = high[event].to_numpy(), low[event].to_numpy(), kinds_of(low)
            levels = {name: rate_of(events, event) for name, events in robots.items()}
            p, gap = exchange_p(above, below, among.unit), difference(above, below, among)
            effects.append(Dependence(event, parameter, p, levels, gap))
    return effects


def adjusted(found: Sequence[Dependence]) -> Iterator[tuple[Dependence, Finding]]:
    """Yield each dependence with its p adjusted over all of them by Holm's method."""
    tested = holm_test({str(k): effect.p for k, effect in enumerate(found)})
    return zip(found, tested.values(), strict=True)


def thirds(values: np.ndarray) -> np.ndarray:
    """Return the number in THIRDS of each value [n] by its rank. Equal values stay together."""
    from scipy.stats import rankdata

    place = (rankdata(values) - 0.5) / max(1, len(values))
    low = (place < 1 / 3) | (values == values.min(initial=np.inf))
    high = (place > 2 / 3) | (values == values.max(initial=-np.inf))
    return np.where(low, 0, np.where(high, 2, 1))


def dependences(
    frame: pd.DataFrame, flags: pd.DataFrame, parameters: Sequence[Uncertain]
) -> list[Dependence]:
    """Return whether each event depends on each parameter, for robots with all parameters drawn.
    The smallest p of an event comes first.

    Mann-Whitney's test detects a rate that rises or falls, and the chi-squared test over thirds
    any other dependence. p is twice the smaller (Bonferroni). Runs are assumed independent.
    """
    found = []
    for event in EVENTS:
        hit, mine = flags[event].to_numpy(bool), []
        for parameter in parameters:
            values = parameter.values(frame)
            code = thirds(values)
            n, k = np.bincount(code, minlength=3), np.bincount(code, hit, minlength=3).astype(int)
            levels = {
                name: share_of_cells(k[i], n[i])
                for i, name in enumerate(THIRDS)
                if 0 < n[i] < len(code)
            }
            gap = Estimate(np.nan, np.nan, np.nan)
            if len(levels) > 1:
                first, *_, last = levels.values()
                gap = rate_difference(last.k, last.n, first.k, first.n)
            p = _p(hit, code, values)
            mine.append(Dependence(event, parameter, p, levels, gap))
        found += sorted(mine, key=lambda at: (np.isnan(at.p), at.p, -abs(at.difference.value)))
    return found


def _p(hit: np.ndarray, code: np.ndarray, values: np.ndarray) -> float:
    """Return p of independence of `hit` [n] from its third `code` [n] and from `values` [n]."""
    from scipy.stats import MonteCarloMethod, chi2_contingency, mannwhitneyu
    from scipy.stats.contingency import crosstab, expected_freq

    table = crosstab(~hit, code).count
    if min(table.shape) < 2:
        return float("nan")
    method = None
    if expected_freq(table).min() < FEWEST_EXPECTED:
        method = MonteCarloMethod(n_resamples=TABLES_DRAWN, rng=np.random.default_rng(0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        association: Any = chi2_contingency(table, correction=False, method=method)
    trend: Any = mannwhitneyu(values[hit], values[~hit])
    return min(1.0, 2 * min(float(association.pvalue), float(trend.pvalue)))


def extremes(robots: Robots, event: str) -> list[tuple[Rate, str]]:
    """Return the lowest and the highest rate of an event over robots, each with its robot."""
    rates = [(rate_of(events, event), name) for name, events in robots.items()]
    return [end(rates, key=lambda pair: pair[0].value) for end in (min, max)]


# --- what determines how far a fault moves the tip ---

SEARCH = f"variants/{NAME}_search.toml"
SEARCHES = {"morris": {"trajectories": 60, "levels": 8}, "sobol": {"n": 128}}


def sensitivity_rows(out: Path, engine: str) -> Iterator[tuple[Cell, ...]]:
    """Run both searches, and yield Morris and Sobol indices for each joint and parameter."""
    common, results = study.read_toml(SEARCH), {}
    words = {one.path: one.words for one in PARAMETERS}
    laws = {one.path: tomllib.loads(f"law = {one.law}")["law"] for one in PARAMETERS}
    for name, method in SEARCHES.items():
        search = {"kind": name, **method, **common["search"]}
        config = loading.from_dict({**common, "parameters": laws, "search": search})
        results[name] = runner.run_search(config, out / name, engine).record["result"]
    morris, sobol = results.values()
    screened, ranked = ([row["name"] for row in found["inputs"]] for found in (morris, sobol))
    many = morris["points"] + sobol["points"]
    for screen, shares in zip(morris["results"], sobol["results"], strict=True):
        effects, parts = screen["indices"], shares["indices"]
        if effects is None or parts is None:
            continue
        size = f"{format_number(shares['mean'])} ± {format_number(shares['deviation'], 2)}"
        joint = str(screen["case"]["fault0_channel"])
        for k in sorted(range(len(ranked)), key=lambda k: -parts["ST"]["value"][k]):
            other = screened.index(ranked[k])
            indices = (parts["ST"], k), (parts["S1"], k), (effects["mu_star"], other)
            estimates = [
                plain(Estimate(*(index[end][at] for end in ("value", "low", "high"))), 2)
                for index, at in indices
            ]
            spread = format_number(effects["sigma"]["value"][other], 2)
            yield joint, size, words[ranked[k]], *estimates, spread, many


# --- tables ---


def conclusion_rows(
    robots: Robots, found: Sequence[Dependence], drawn: Sequence[Dependence]
) -> Iterator[tuple[Cell, ...]]:
    """Yield each event, its range over robots, and the parameters on which it depends."""
    alone, together = (
        [effect for effect, finding in adjusted(part) if finding.rejected]
        for part in (found, drawn)
    )
    alone.sort(key=lambda effect: -abs(effect.difference.value))
    for event, words in EVENTS.items():
        (low, low_robot), (high, high_robot) = extremes(robots, event)
        effects = [
            f"{effect.parameter.words} ({'+' if effect.difference.value > 0 else ''}"
            f"{format_number(100.0 * effect.difference.value, 2)})"
            for effect in alone
            if effect.event == event
        ]
        others = [effect.parameter.words for effect in together if effect.event == event]
        ends = " to ".join(format_percent(end.value) for end in (low, high))
        dependent = (", ".join(some) or "none detected" for some in (effects, others))
        known = rate(rate_of(robots[KNOWN_ROBOT], event))
        yield words, known, ends, f"{low_robot}; {high_robot}", *dependent


def end_rows(found: Sequence[Dependence]) -> Iterator[tuple[Cell, ...]]:
    """Yield every rate at both ends of every parameter."""
    for effect, finding in adjusted(found):
        parameter, (low, high) = effect.parameter, effect.levels.values()
        words, gap = f"{parameter.words}, {parameter.range}", difference_and_p(effect, finding)
        yield EVENTS[effect.event], words, low.n, rate(low), rate(high), *gap


def third_rows(drawn: Sequence[Dependence]) -> Iterator[tuple[Cell, ...]]:
    """Yield rates by thirds of each parameter."""
    for effect, finding in adjusted(drawn):
        levels = effect.levels
        cells = (rate(levels[name]) if name in levels else wording.DASH for name in THIRDS)
        gap = difference_and_p(effect, finding)
        yield EVENTS[effect.event], effect.parameter.words, *cells, *gap


def difference_and_p(effect: Dependence, finding: Finding) -> tuple[str, str]:
    """Write the difference of rates in points, with its interval, and its adjusted p."""
    points = Estimate(*(100.0 * value for value in effect.difference))
    return plain(points, 2), format_number(finding.adjusted, 2)


def layer_rows(robots: Robots) -> Iterator[tuple[Cell, ...]]:
    """Yield whether the order of layers depends on the robot."""
    rates = {}
    for name in LAYERS.values():
        parts = [events.loc[events["layer"] == name] for events in robots.values()]
        if all(map(len, parts)):
            rates[name] = [rate_of(part, LAYER_EVENT) for part in parts]
    order = [sorted(rates, key=lambda name: -rates[name][k].value) for k in range(len(robots))]
    for name, mine in rates.items():
        low, high = (format_percent(end(found.value for found in mine)) for end in (min, max))
        places = [names.index(name) + 1 for names in order]
        yield name, rate(mine[0]), low, high, places[0], f"{min(places)} to {max(places)}"


def compare(context: study.Context) -> study.Findings:
    """Compare rates on all robots, and find what determines how far a fault moves the tip."""
    folders, robots, ends = context.folders, {}, {}
    robots[KNOWN_ROBOT] = read(folders[KNOWN])[1]
    for one in PARAMETERS:
        name = one.path.removeprefix("plant.").replace(".", "_")
        ends[one] = robots_at_ends(folders[f"alone_{name}"], one)
        robots |= ends[one]
    robots |= {f"set {name}": read(folders[f"set_{name}"])[1] for name in SETS}
    effects = parameter_effects(ends)
    frames, flags = zip(*(read(folders[f"drawn_{seed}"]) for seed in SEEDS), strict=True)
    drawn = dependences(pd.concat(frames), pd.concat(flags), PARAMETERS)
    searches = folders[KNOWN].parent.parent / "searches"
    units_of = {one: bounds.allowed_values(ROBOT, one.path)[0].unit for one in PARAMETERS}
    tables = {
        "conclusions": conclusion_rows(robots, effects, drawn),
        "layers": layer_rows(robots),
        # Ranges and their sources
        "parameters": (
            (one.words, one.path, one.range, one.nominal, unit, one.law, one.source)
            for one, unit in units_of.items()
        ),
        "ends": end_rows(effects),
        "thirds": third_rows(drawn),
        "sensitivity": sensitivity_rows(searches, context.engine),
    }
    (outcome,) = study.read_toml(SEARCH)["search"]["outcomes"]
    words = {"robots": len(robots), "event": EVENTS[LAYER_EVENT], "outcome": outcome}
    return study.Findings(
        tuple(_lines(robots)),
        tuple(read_table(NAME, key, rows, **words) for key, rows in tables.items()),
        study.read_notes(NAME, robots=len(robots)),
    )


def _lines(robots: Robots) -> Iterator[study.Line]:
    known, cycle = robots[KNOWN_ROBOT], robots[EVERY_CYCLE]
    of = f"faults of the campaign, {kinds.count(kinds_of(known))}, known robot"
    for event, words in EVENTS.items():
        share = rate_of(known, event)
        yield study.percent_line(words, share, of)
        yield study.percent_line(f"{words}, one packet per cycle", rate_of(cycle, event), of)
        (low, _), (high, _) = extremes(robots, event)
        span = Estimate(share.value, low.value, high.value)
        value = study.in_percent(span, len(robots), "robots")
        yield study.own_line(f"{words}, range over robots", "%", value)


STUDY = study.study(NAME, study.read_variants(NAME), compare)

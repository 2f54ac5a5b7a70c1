"""Tables of the study of the uncertain robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ravenjax.report import wording
from ravenjax.stats.inputs.association import Dependence
from ravenjax.stats.intervals import Estimate, Rate, share
from studies.framework import kinds
from studies.framework.study import Table
from studies.reaction.tables import rate
from studies.uncertainty import rates as uncertain_rates
from studies.uncertainty.parameters import Uncertain
from studies.uncertainty.rates import EVENTS, ParameterEffect, RobotRates
from studies.uncertainty.search import Index

NONE = "none of those tried"


def parameters(listed: Sequence[Uncertain]) -> Table:
    """Ranges and their sources."""
    return Table(
        "What is not known of the robot",
        (
            "parameter",
            "path",
            "range",
            "known robot",
            "unit",
            "drawn",
            "where the range comes from",
        ),
        tuple(
            (
                one.words,
                one.path,
                f"{one.low:g} to {one.high:g}",
                one.nominal,
                one.unit,
                one.law,
                one.source,
            )
            for one in listed
        ),
    )


def conclusions(
    known: RobotRates,
    listed: Sequence[RobotRates],
    found: Sequence[ParameterEffect],
    drawn: Sequence[tuple[str, Dependence]],
    words: Mapping[str, str],
) -> Table:
    """Each conclusion, its range over robots, and what it depends on. words: path -> parameter
    in words.
    """
    judged = uncertain_rates.judged([one.p for one in found])
    rows = []
    for event, words_of in EVENTS.items():
        span = uncertain_rates.over(listed, event)
        mine = [
            (one, finding)
            for one, finding in zip(found, judged, strict=True)
            if one.event == event and finding.rejected
        ]
        mine.sort(key=lambda item: -abs(item[0].difference.value))
        alone = [f"{one.parameter.words} ({signed(one.difference.value)})" for one, _ in mine]
        together = [words[one.name] for name, one in drawn if name == event and one.depends]
        rows.append(
            (
                words_of,
                rate(known.rate(event)),
                f"{percent(span.low)} to {percent(span.high)}",
                f"{span.low_robot}; {span.high_robot}",
                ", ".join(alone) or NONE,
                ", ".join(together) or NONE,
            )
        )
    return Table(
        "Which conclusions depend on the robot",
        (
            "share of faults",
            "known robot",
            f"lowest and highest of {len(listed)} robots",
            "on which robots",
            "depends on (same faults, one parameter from its low to its high end, points)",
            "depends on (all drawn together, thirds)",
        ),
        tuple(rows),
        f"The {len(listed)} robots: the known one, each parameter at each end of its range, the"
        " published sets; the same faults on all. Depends: p below 0.05 after Holm over all"
        " conclusions and parameters of that column; on the same faults exact, both ends exchanged"
        " kind by kind; on drawn robots Mann-Whitney and chi-squared over thirds. That a"
        " conclusion is not seen to depend on a parameter is no proof: differences below some"
        f" points do not show among so many kinds of faults. {kinds.NOTE}",
    )


def ends(found: Sequence[ParameterEffect]) -> Table:
    """Every rate at both ends of every parameter."""
    judged = uncertain_rates.judged([one.p for one in found])
    return Table(
        "One parameter at a time, the same faults",
        (
            "share of faults",
            "parameter",
            "faults",
            "at the low end",
            "at the high end",
            "difference, points",
            "p (Holm)",
        ),
        tuple(
            (
                EVENTS[one.event],
                f"{one.parameter.words}, {one.parameter.low:g} to {one.parameter.high:g}",
                one.low.n,
                rate(one.low),
                rate(one.high),
                points(one.difference),
                wording.number(finding.adjusted, 2),
            )
            for one, finding in zip(found, judged, strict=True)
        ),
        "Difference: high minus low end, pairs of the same fault and random numbers. p: both ends"
        " exchanged kind by kind, exact, Holm over the table; – where no fault came out"
        f" differently. {kinds.NOTE}",
    )


def thirds(drawn: Sequence[tuple[str, Dependence]], words: Mapping[str, str]) -> Table:
    """Rates by thirds of each parameter."""
    rows = []
    for event, one in drawn:
        by_level = {level.name: rate(share(level.rate.k, level.rate.n)) for level in one.levels}
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
                wording.number(one.adjusted, 2),
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


def robots(listed: Sequence[RobotRates]) -> Table:
    """Every rate on every robot."""
    return Table(
        "Every robot",
        ("robot", "faults", *EVENTS.values()),
        tuple(
            (robot.name, len(robot.events), *(rate(robot.rate(event)) for event in EVENTS))
            for robot in listed
        ),
        "The same faults under the same random numbers; those that changed a bit. Two robots"
        f" differ more clearly than their intervals say. {kinds.NOTE}",
    )


def by_layer(listed: Sequence[RobotRates], event: str) -> Table:
    """Whether the order of layers depends on the robot."""
    rates_of = uncertain_rates.by_layer(listed, event)
    places: dict[str, list[int]] = {name: [] for name in rates_of}
    for k in range(len(listed)):
        order = sorted(rates_of, key=lambda name: -rates_of[name][k].value)
        for name in rates_of:
            places[name].append(order.index(name) + 1)
    return Table(
        f"Does the order of layers depend on the robot? Share of faults with: {EVENTS[event]}",
        (
            "layer",
            "known robot, of the layer's faults",
            f"lowest of {len(listed)} robots",
            "highest",
            "place on the known robot",
            "places on all robots",
        ),
        tuple(
            (
                name,
                rate(rates[0]),
                percent(min(rates, key=lambda one: one.value)),
                percent(max(rates, key=lambda one: one.value)),
                places[name][0],
                f"{min(places[name])} to {max(places[name])}",
            )
            for name, rates in rates_of.items()
        ),
        "Place 1 is the layer whose faults do it most often. The first robot is the known one."
        " Intervals as in the table before: none with fewer than 5 kinds of faults.",
    )


def sensitivity(found: Sequence[Index], outcome: str) -> Table:
    """Morris and Sobol."""
    return Table(
        "What decides how far an unchecked command throws the tip",
        (
            "joint",
            "mean ± deviation over robots, mm",
            "parameter",
            "Sobol, total",
            "Sobol, first order",
            "Morris, mean |effect|, mm",
            "Morris, deviation, mm",
            "runs",
        ),
        tuple(
            (
                one.case,
                f"{wording.number(one.mean_mm)} ± {wording.number(one.deviation_mm, 2)}",
                one.parameter.words,
                number(Estimate(*one.total)),
                number(Estimate(*one.first)),
                number(Estimate(*one.effect)),
                wording.number(one.spread, 2),
                one.runs,
            )
            for one in found
        ),
        f"`{outcome}` of 4000 counts added behind every check for 32 ms. Total: share of the"
        " variance over robots that the parameter causes, alone and together with others. Mean"
        " |effect|: change over the whole range. 95 %, bootstrap. First orders scatter about 0"
        " where there is nothing. Totals do not: every run draws its own noise, which no parameter"
        " explains and every total contains; the delay of the brakes, which close in none of these"
        " runs, shows how much.",
    )


# --- cells ---


def percent(found: Rate) -> str:
    """12.3 %."""
    return wording.percent(found.value)


def points(difference: Estimate) -> str:
    """A difference of rates in points, with its interval."""
    return number(Estimate(*(100.0 * value for value in difference)))


def signed(difference: float) -> str:
    """+1.2, in points."""
    text = wording.number(100.0 * difference, 2)
    return f"+{text}" if difference > 0 else text


def number(found: Estimate) -> str:
    """A number with its interval."""
    if math.isnan(found.value):
        return wording.DASH
    value, low, high = (wording.number(end + 0.0, 2) for end in found)
    return value if math.isnan(found.low) else f"{value} ({low} to {high})"

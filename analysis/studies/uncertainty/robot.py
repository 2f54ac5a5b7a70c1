"""Which conclusions depend on the robot? The same faults on robots that differ in what nobody
knows exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pandas as pd

from ravenjax.stats.inputs.association import Dependence
from studies.framework import kinds
from studies.framework.study import (
    Context,
    Drawing,
    Findings,
    Line,
    Study,
    StudyEstimate,
    Variant,
)
from studies.uncertainty import drawings, rates, search, tables
from studies.uncertainty.parameters import PARAMETERS, SETS, Uncertain
from studies.uncertainty.rates import EVENTS, ParameterEffect, RobotRates

CAMPAIGN = "uncertain_robot.toml"
KNOWN = "known"
SEEDS = (1, 2, 3)
"""Of as many draws of faults and robots together."""
LAYER_EVENT = "unintended"
WORDS = {one.path: one.words for one in PARAMETERS}


def compare(context: Context) -> Findings:
    """Rates on every robot, one parameter at a time and all together, and what decides how far a
    fault throws.
    """
    frame, flags = rates.read(context.folders[KNOWN])
    base = RobotRates("known robot", flags.set_axis(pd.Index(frame[rates.FAULT])))
    ends = {one: rates.robots(*rates.read(context.folders[_alone(one)]), one) for one in PARAMETERS}
    sets = [_set(context, name) for name in SETS]
    robots = [base, *(robot for pair in ends.values() for robot in pair), *sets]
    effects = rates.effects(ends)
    thirds = _thirds(context)
    decided = search.find(context.folders[KNOWN].parent.parent / "searches", context.engine)
    return Findings(
        lines=tuple(_lines(base, robots, effects)),
        tables=(
            tables.conclusions(base, robots, effects, thirds, WORDS),
            tables.by_layer(robots, LAYER_EVENT),
            tables.parameters(PARAMETERS),
            tables.ends(effects),
            tables.thirds(thirds, WORDS),
            tables.sensitivity(decided, search.OUTCOME),
            tables.robots(robots),
        ),
        drawings=(
            Drawing(
                "ranges",
                "Rates of five conclusions with one parameter at each end of its range, and on the"
                " other published sets of parameters; the same faults on all. Band: 95 % of the"
                " known robot's rate, over kinds of faults.",
                drawings.ranges(base, {one.words: pair for one, pair in ends.items()}, sets),
            ),
            Drawing(
                "layers",
                "Share of faults that make an unintended motion, by the layer where they strike:"
                " every robot, the same faults.",
                drawings.layers(rates.by_layer(robots, LAYER_EVENT), LAYER_EVENT),
            ),
            Drawing(
                "indices",
                "What decides how far 4000 counts, added behind every check for 32 ms, throw the"
                " tip: total Sobol index of each parameter of the robot, 95 %.",
                drawings.indices(decided),
            ),
        ),
        notes=_notes(len(robots), *rates.rounding(base, ends)),
    )


def _alone(parameter: Uncertain) -> str:
    """Variant in which a parameter is at both ends."""
    return "alone_" + parameter.path.removeprefix("plant.").replace(".", "_")


def _set(context: Context, name: str) -> RobotRates:
    frame, flags = rates.read(context.folders[f"set_{name}"])
    return RobotRates(f"set {name}", flags.set_axis(pd.Index(frame[rates.FAULT])))


def _thirds(context: Context) -> list[tuple[str, Dependence]]:
    parts = [rates.read(context.folders[f"drawn_{seed}"]) for seed in SEEDS]
    columns = [one.column for one in PARAMETERS]
    frame = pd.DataFrame(pd.concat([frame[columns] for frame, _ in parts], ignore_index=True))
    return rates.thirds(
        frame, pd.concat([flags for _, flags in parts], ignore_index=True), PARAMETERS
    )


def _lines(
    known: RobotRates, robots: Sequence[RobotRates], effects: Sequence[ParameterEffect]
) -> Iterator[Line]:
    for event, words in EVENTS.items():
        rate = known.rate(event)
        of = f"faults of this design, {kinds.count(known.faults)}, the known robot"
        value = StudyEstimate(100 * rate.value, 100 * rate.low, 100 * rate.high, rate.n, of)
        yield Line(words, "%", None, value)
        span = rates.over(robots, event)
        many = StudyEstimate(
            100 * rate.value,
            100 * span.low.value,
            100 * span.high.value,
            len(robots),
            "robots, extremes",
        )
        yield Line(f"{words}, over robots", "%", None, many)
    judged = rates.judged([one.p for one in effects])
    for parameter in PARAMETERS:
        depends = [
            f.rejected for one, f in zip(effects, judged, strict=True) if one.parameter == parameter
        ]
        value = StudyEstimate(sum(depends), n=len(EVENTS), of="conclusions")
        yield Line(f"conclusions that depend on: {parameter.words}", "", None, value)


def _notes(robots: int, rounding: float, same: int) -> tuple[str, ...]:
    return (
        (
            "One parameter at a time, every fault is run at both ends under the same random"
            " numbers, so a difference is the parameter's. All parameters drawn together, each run"
            " has a fault and a robot of its own: that shows whether a dependence survives among"
            " all others, and needs far larger effects to be seen."
        ),
        (
            f"The range over {robots} robots is of robots that differ in one parameter, and of the"
            " published sets, which differ in many. A robot at several ends at once can lie"
            " outside."
        ),
        (
            "The nominal model, and with it the cue, stays that of the known robot, as a"
            " simulator's does when the real robot changes: a part of each dependence is the"
            " model's misfit rather than the fault's doing. Each run is judged against the golden"
            " run of its own robot."
        ),
        (
            "Two control cycles a packet make the operator's increments come at half the rate, so"
            " that the hand moves at half its speed; that is another task and not only another"
            " robot. And the jump rule counts steps from packet to packet, which are then twice as"
            " long: what it says depends on the rate of packets by its definition."
        ),
        (
            f"{same} of the robots are the known one again, as one end of a range is the known"
            f" value: their rates differ from its by up to {100 * rounding:.2g} points. Nothing but"
            " rounding differs there (a value that is varied enters the computation in another way"
            " than one that is fixed), and decides runs at the very edge of an event. Differences"
            " of that size are nothing."
        ),
        (
            "A delay of commands acts between the boards and the motors, behind every check;"
            " encoders are read without one."
        ),
        (
            "Faults are drawn as in the quick campaign: shares are of its design, not of what"
            " occurs, and hide that sites differ far more than robots do; the table of layers shows"
            " that."
        ),
    )


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


STUDY = Study(
    name="uncertain_robot",
    title="Which conclusions depend on the robot?",
    source=(
        "a study of our own; parameters: the published sets of raven2_sim, and assumptions as the"
        " table says"
    ),
    question=(
        "Which rates of the quick campaign would be others on a robot that differs in what nobody"
        " knows exactly?"
    ),
    variants=tuple(_variants()),
    compare=compare,
    minutes=2.0,
)

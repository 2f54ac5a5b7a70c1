"""Figures of the study of the uncertain robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ravenjax.stats.intervals import Rate
from studies.framework.drawing import MUTED, PREDICTED, SERIES, WIDTH_IN
from studies.uncertainty.rates import EVENTS, RobotRates
from studies.uncertainty.search import Index

LOW, HIGH = SERIES[5], SERIES[1]
SHOWN = {
    "evaded": "evades",
    "cue": "cue fires",
    "stopped": "check stops",
    "unintended": "unintended motion",
    "loss": "loss of motion",
}


def ranges(
    known: RobotRates, ends: Mapping[str, tuple[RobotRates, RobotRates]], sets: Sequence[RobotRates]
) -> Callable[[Any], None]:
    """Draws each rate at both ends of each parameter, and on the published sets, about that of
    the known robot.
    """
    names = [*ends, *(robot.name for robot in sets)]

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 0.24 * len(names) + 1.3)
        panels = figure.subplots(1, len(SHOWN), sharey=True, squeeze=False)[0]
        for axis, (event, title) in zip(panels, SHOWN.items(), strict=True):
            rate = known.rate(event)
            axis.axvspan(100 * rate.low, 100 * rate.high, color="0.93", lw=0)
            axis.axvline(100 * rate.value, color=MUTED, lw=1.0)
            for place, (low, high) in enumerate(ends.values()):
                values = [100 * robot.rate(event).value for robot in (low, high)]
                axis.plot(values, [place, place], color="0.55", lw=1.6, zorder=2)
                axis.plot(values[0], place, "o", ms=4.5, color=LOW, zorder=3)
                axis.plot(values[1], place, "o", ms=4.5, color=HIGH, zorder=4)
            for place, robot in enumerate(sets, len(ends)):
                axis.plot(100 * robot.rate(event).value, place, "D", ms=4, color=PREDICTED)
            axis.axhline(len(ends) - 0.5, color="0.8", lw=0.8)
            axis.set(title=title, xlabel="% of faults")
            axis.grid(axis="y", visible=False)
        panels[0].set_yticks(range(len(names)), names)
        panels[0].set_ylim(len(names) - 0.5, -0.5)
        keys = [("low end", "o", LOW), ("high end", "o", HIGH), ("published set", "D", PREDICTED)]
        handles = [
            panels[0].plot([], [], marker, color=colour, ms=4.5, label=name)[0]
            for name, marker, colour in keys
        ]
        handles.append(panels[0].plot([], [], color=MUTED, lw=1.0, label="known robot, 95 %")[0])
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))

    return draw


def layers(found: Mapping[str, Sequence[Rate]], event: str) -> Callable[[Any], None]:
    """Draws the rate of an event by layer: every robot a dot."""

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 0.32 * len(found) + 1.0)
        axis = figure.subplots()
        for place, rates in enumerate(found.values()):
            others = [100 * rate.value for rate in rates[1:]]
            axis.plot(
                others,
                [place] * len(others),
                "o",
                ms=5,
                color=SERIES[5],
                alpha=0.45,
                mew=0,
                label=None if place else "another robot",
            )
            axis.plot(
                100 * rates[0].value,
                place,
                "s",
                ms=4,
                color="0.2",
                label=None if place else "known robot",
            )
        axis.set_yticks(range(len(found)), list(found))
        axis.set(
            xlabel=f"% of faults: {EVENTS[event]}", ylim=(len(found) - 0.5, -0.5), xlim=(0, None)
        )
        axis.grid(axis="y", visible=False)
        axis.legend(loc="lower right")

    return draw


def indices(found: Sequence[Index]) -> Callable[[Any], None]:
    """Draws total Sobol indices, one panel a joint, parameters in one order."""
    cases = list(dict.fromkeys(one.case for one in found))
    most: dict[str, float] = {}
    for one in found:
        most[one.parameter.words] = max(most.get(one.parameter.words, 0.0), one.total[0])
    names = sorted(most, key=lambda name: -most[name])

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 0.24 * len(names) + 1.1)
        panels = figure.subplots(1, len(cases), sharey=True, sharex=True, squeeze=False)[0]
        for axis, case in zip(panels, cases, strict=True):
            for one in (one for one in found if one.case == case):
                place = names.index(one.parameter.words)
                value, low, high = (100 * part for part in one.total)
                axis.barh(place, value, height=0.6, color=PREDICTED, alpha=0.85)
                axis.errorbar(
                    value,
                    place,
                    xerr=[[max(0.0, value - low)], [max(0.0, high - value)]],
                    fmt="none",
                    color="0.25",
                    capsize=2,
                    elinewidth=0.9,
                )
            axis.set(title=case, xlabel="total index, %")
            axis.grid(axis="y", visible=False)
        panels[0].set_yticks(range(len(names)), names)
        panels[0].set_ylim(len(names) - 0.5, -0.5)
        panels[0].set_xlim(0, None)

    return draw

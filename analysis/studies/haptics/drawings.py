"""Figures of the study of the haptic cue."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.stats.alarms.pareto import front
from studies.detection.drawings import incidences
from studies.detection.points import latencies, share
from studies.detection.runs import per_hour
from studies.framework.drawing import MUTED, PREDICTED, SERIES, THRESHOLD, WIDTH_IN
from studies.framework.study import Drawing
from studies.haptics.choice import Winners
from studies.haptics.runs import FaultyCues, FreeCues, sets_at
from studies.haptics.tables import damper

SHOWN_MM = (1.0, 2.0, 3.0, 5.0, 8.0)
"""Thresholds whose times are drawn."""


def drawings(
    faulty: FaultyCues, modelled: FreeCues, sets: Sequence[int], fine: Winners
) -> tuple[Drawing, ...]:
    """Every figure; `sets`: numbers of those with the published gains, `fine`: the choice at
    many weights.
    """
    moved = faulty.unintended
    never = (faulty.first_ms[moved] < 0).mean(axis=0)
    false = modelled.count.sum(axis=0) / modelled.hours.sum()
    thresholds = np.array([faulty.cues[k].threshold_mm for k in sets])
    cue_ms = faulty.first_ms[:, list(sets)]
    rates = {
        "felt": [share(cue_ms[:, j] >= 0, moved, faulty.faults, "") for j in range(len(sets))],
        "felt before it began": [
            share(
                (cue_ms[:, j] >= 0) & (cue_ms[:, j] < faulty.unintended_ms),
                moved,
                faulty.faults,
                "",
            )
            for j in range(len(sets))
        ],
        "other faults felt": [
            share(cue_ms[:, j] >= 0, ~moved, faulty.faults, "") for j in range(len(sets))
        ],
    }
    felt = {
        name: 100 * np.array([[r.value, r.low, r.high] for r in shares]).T
        for name, shares in rates.items()
    }
    by_scale = {}
    for scale in np.unique(modelled.scale):
        mine = modelled.where(modelled.scale == scale)
        by_scale[f"scale {scale:g}"] = np.array(
            [per_hour(mine.count[:, k], mine.hours, mine.recording).value for k in sets]
        )
    scale_hours = float(modelled.hours.sum()) / max(1, len(by_scale))
    once = faulty.where(moved).once()
    curves = {}
    for k in sets:
        if faulty.cues[k].threshold_mm in SHOWN_MM:
            curves[f"{faulty.cues[k].threshold_mm:g} mm"] = latencies(
                once.first_ms[:, k], once.active_ms, once.unintended_ms, float(faulty.duration_ms)
            )
    return (
        Drawing(
            "haptic_front",
            f"Unintended motion missed against false cues an hour, {len(faulty.cues)} sets of"
            " threshold and gains; the line joins the published gains, numbers are thresholds in"
            " mm, the ring is the published set.",
            _front(
                never,
                false,
                sets,
                thresholds,
                list(sets).index(faulty.published),
                float(modelled.hours.sum()),
            ),
        ),
        Drawing(
            "haptic_threshold",
            "What a threshold tells of faults with unintended motion and of others (95 % over"
            " kinds), and how often it speaks for nothing, by scale.",
            _threshold(thresholds, felt, by_scale, scale_hours),
        ),
        Drawing(
            "haptic_choice",
            "The threshold that the data would choose, by how many false cues a missed unintended"
            " motion an hour weighs; shades: how often each wins when kinds of faults and"
            " recordings are drawn anew.",
            _choice(thresholds, fine),
        ),
        Drawing(
            "haptic_time",
            "When a fault with unintended motion is felt, after its first effect and before the"
            " motion began, by threshold. Kaplan-Meier.",
            incidences(
                curves, "faults felt, %", 4.2, lambda _, left: left.legend(loc="upper left")
            ),
        ),
        Drawing(
            "haptic_force",
            "How strongly unintended motion is felt at the published threshold, by gains: largest"
            " force of each run that is felt, device units; bars: quartiles, whiskers: 5 and 95 %.",
            _force(faulty),
        ),
    )


def _front(
    never: np.ndarray,
    false: np.ndarray,
    sets: Sequence[int],
    thresholds: np.ndarray,
    published: int,
    hours: float,
) -> Callable[[Any], None]:
    least = 0.4 / hours

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 4.4)
        axis = figure.subplots()
        rate, missed = np.maximum(false, least), 100 * never
        best = front(never, false)
        axis.plot(rate[~best], missed[~best], ".", color="0.72", ms=5, label="beaten by another")
        axis.plot(rate[best], missed[best], "o", color=SERIES[2], ms=5, label="beaten by none")
        own = list(sets)
        axis.plot(rate[own], missed[own], color=PREDICTED, lw=1.2, label="published gains")
        last = (0.0, np.inf)
        for k, mm in zip(own, thresholds, strict=True):
            here = (float(np.log10(rate[k])), float(missed[k]))
            if abs(here[0] - last[0]) > 0.15 or abs(here[1] - last[1]) > 3:
                axis.annotate(
                    f"{mm:g}",
                    (rate[k], missed[k]),
                    (5, 6),
                    textcoords="offset points",
                    fontsize=7.5,
                )
                last = here
        axis.plot(
            rate[own[published]],
            missed[own[published]],
            "o",
            ms=11,
            mfc="none",
            mec=THRESHOLD,
            mew=1.6,
            label="published set",
        )
        axis.set_xscale("log")
        axis.set(
            xlabel=f"false cues an hour, in {hours:.1f} h",
            ylabel="unintended motion missed, %",
            ylim=(0, None),
        )
        if (false == 0).any():
            axis.axvspan(least / 1.25, least * 1.25, color="0.94", lw=0, zorder=0)
            axis.text(least, 0.5, "none seen", fontsize=7, color="0.35", ha="center", rotation=90)
        axis.legend()

    return draw


def _threshold(
    thresholds: np.ndarray,
    felt: dict[str, np.ndarray],
    by_scale: dict[str, np.ndarray],
    hours: float,
) -> Callable[[Any], None]:
    least = 0.4 / hours

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 4.2)
        left, right = figure.subplots(1, 2)
        for colour, (name, (value, low, high)) in zip(SERIES, felt.items(), strict=False):
            left.plot(thresholds, value, color=colour, lw=1.4, marker=".", ms=5, label=name)
            left.fill_between(thresholds, low, high, color=colour, alpha=0.15, lw=0)
        for colour, (name, rate) in zip(SERIES[3:], by_scale.items(), strict=False):
            right.plot(
                thresholds,
                np.maximum(rate, least),
                color=colour,
                lw=1.4,
                marker=".",
                ms=5,
                label=name,
            )
        right.set_yscale("log")
        right.axhspan(least / 1.25, least * 1.25, color="0.94", lw=0, zorder=0)
        right.text(0.5, least, "none seen", fontsize=7, color="0.35", va="center")
        for axis in (left, right):
            axis.axvline(3.0, color=THRESHOLD, lw=0.9, ls="--")
            axis.set_xlabel("threshold, mm")
            axis.legend()
        left.set(title="Faults", ylabel="% of runs", ylim=(0, 101))
        right.set(title=f"No fault, {hours:.2f} h a scale", ylabel="false cues an hour")

    return draw


def _choice(thresholds: np.ndarray, found: Winners) -> Callable[[Any], None]:
    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 4.0)
        axis = figure.subplots()
        rows = np.arange(len(thresholds))
        image = axis.pcolormesh(
            found.weight,
            rows,
            100 * found.wins.T,
            cmap="Blues",
            vmin=0,
            vmax=100,
            shading="nearest",
        )
        axis.step(found.weight, found.winner, where="mid", color=SERIES[1], lw=1.6, label="chosen")
        axis.axhline(
            list(thresholds).index(3.0), color=THRESHOLD, lw=0.9, ls="--", label="published"
        )
        axis.set_xscale("log")
        axis.grid(False)
        axis.set_yticks(rows, [f"{mm:g}" for mm in thresholds])
        axis.set(
            xlabel="false cues that a missed unintended motion an hour weighs",
            ylabel="threshold, mm",
        )
        axis.legend(loc="upper right")
        figure.colorbar(image, ax=axis, label="wins, % of draws")

    return draw


def _force(faulty: FaultyCues) -> Callable[[Any], None]:
    numbers = sets_at(faulty.cues, faulty.cues[faulty.published].threshold_mm)

    def draw(figure: Any) -> None:
        figure.set_size_inches(WIDTH_IN, 3.6)
        axis = figure.subplots()
        for place, k in enumerate(numbers):
            force = faulty.force[faulty.unintended & (faulty.first_ms[:, k] >= 0), k]
            if not len(force):
                continue
            low, first, middle, third, high = np.percentile(force, [5, 25, 50, 75, 95])
            colour = THRESHOLD if k == faulty.published else PREDICTED
            axis.plot([place, place], [low, high], color=colour, lw=1.0)
            axis.bar(place, third - first, 0.55, bottom=first, color=colour, alpha=0.35, lw=0)
            axis.plot([place - 0.27, place + 0.27], [middle, middle], color=colour, lw=2.0)
        cap = faulty.cues[faulty.published].cap
        if cap is not None:
            axis.axhline(cap, color=MUTED, lw=0.9, ls="--")
            axis.text(-0.45, cap, "cap", fontsize=8, color=MUTED, va="bottom")
        words = [f"Kp {faulty.cues[k].kp_per_mm:g}\nKd {damper(faulty.cues[k])}" for k in numbers]
        axis.set_xticks(range(len(numbers)), words, fontsize=7.5)
        axis.set(ylabel="largest force, device units", ylim=(0, None))

    return draw

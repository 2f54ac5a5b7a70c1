"""The haptic cue: what is felt of which fault, when, how strongly, how often for nothing, and at
which threshold.

All sets of threshold and gains are felt in the same runs. The operator does not react, so the cue
changes nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.outcomes import events
from ravenjax.report.data import draws
from ravenjax.store import manifest
from studies.detection.points import MOVED, hundred, share
from studies.detection.runs import AS_MODELLED, per_hour
from studies.framework import kinds, motions_alike
from studies.framework.motions_alike import MOTIONS, RECORDINGS
from studies.framework.study import Context, Findings, Line, Study, StudyEstimate, Variant
from studies.haptics import choice as haptic_choice
from studies.haptics import drawings, runs, tables
from studies.haptics.choice import Winners
from studies.haptics.runs import UNINTENDED, FaultyCues, FreeCues
from studies.haptics.tables import missed, sums

CAMPAIGN = "haptic_sweep.toml"
FREE_RUNS, FREE_S = 32, 120
EARLY_MM = 1.0
"""A threshold below the limit of the unintended motion, which is compared whatever the choice."""


class _Choice(NamedTuple):
    """Sets that are compared: those with the published gains, by rising threshold, and the
    winners among them.
    """

    sets: list[int]
    winners: Winners

    @property
    def numbers(self) -> list[int]:
        """Numbers of the sets that win at any weight of the tables, by rising threshold."""
        return [self.sets[k] for k in np.unique(self.winners.winner)]


def compare(context: Context) -> Findings:
    """All sets over the same runs."""
    faulty = runs.faulty([context.folders[name] for name in MOTIONS])
    free = runs.free([(f"{m} {s}", context.folders[f"free_{m}_{s}"]) for m, s in RECORDINGS])
    drawn_groups = draws.groups(manifest.read(context.folders[MOTIONS[0]]).config) or ()
    return findings(faulty, free, drawn_groups)


def findings(faulty: FaultyCues, free: FreeCues, drawn_groups: Collection[str] = ()) -> Findings:
    """As `compare`, of runs at hand; drawn_groups: groups whose faults were drawn."""
    modelled = free.where(free.robot == AS_MODELLED)
    sets = runs.default_sets(faulty.cues, faulty.published)
    choice = _Choice(
        sets,
        haptic_choice.choose(
            sums(faulty, modelled, sets, UNINTENDED), np.array(haptic_choice.WEIGHTS)
        ),
    )
    early = [k for k in sets if faulty.cues[k].threshold_mm == EARLY_MM]
    compared = list(dict.fromkeys([faulty.published, *early, *choice.numbers]))
    fine = haptic_choice.choose(
        sums(faulty, modelled, sets, UNINTENDED), np.geomspace(0.1, 1e6, 57)
    )
    return Findings(
        lines=tuple(_lines(faulty, modelled, choice, compared)),
        tables=(
            tables.threshold_table(faulty, free, sets),
            tables.choice_table(faulty, choice.sets, choice.winners),
            tables.versus_table(faulty, free, compared),
            tables.rules_table(faulty, free, sets),
            tables.front_table(faulty, modelled),
            tables.gain_table(faulty, modelled, compared[:2]),
            tables.motion_table(free, sets),
            tables.layer_table(faulty, compared[:2]),
            tables.kind_table(faulty, compared[:2], drawn_groups),
            tables.shared_table(faulty, MOTIONS, sets),
        ),
        drawings=drawings.drawings(faulty, modelled, sets, fine),
        notes=_notes(faulty, modelled),
    )


def _lines(
    faulty: FaultyCues, modelled: FreeCues, choice: _Choice, compared: Sequence[int]
) -> list[Line]:
    moved = faulty.unintended
    cells = StudyEstimate(
        len(np.unique(faulty.cell)), of=f"{kinds.count(faulty.faults)}, {len(MOTIONS)} motions"
    )
    lines = [
        Line("faults, distinct", "", None, cells),
        Line(
            "faulty runs with unintended motion",
            "runs",
            None,
            StudyEstimate(int(moved.sum()), n=len(moved), of="activated runs of this design"),
        ),
        Line(
            "motion without a fault, robot as modelled",
            "h",
            None,
            StudyEstimate(round(float(modelled.hours.sum()), 2)),
        ),
    ]
    for k in compared:
        words = f"{faulty.cues[k].threshold_mm:g} mm" + (
            " (published)" if k == faulty.published else ""
        )
        never = missed(faulty, [k])[:, 0]
        before = (faulty.first_ms[:, k] >= 0) & (faulty.first_ms[:, k] < faulty.unintended_ms)
        rates = {"unintended motion missed": never}
        if not tables.by_definition(faulty, k):
            rates["unintended motion felt before it began"] = before
        lines += [
            Line(f"{words}: {what}", "%", None, hundred(share(hit, moved, faulty.faults, MOVED)))
            for what, hit in rates.items()
        ]
        if not tables.by_definition(faulty, k):
            lines.append(
                Line(
                    f"{words}: median lead over the motion",
                    "ms",
                    None,
                    tables.felt(faulty, k).lead_ms,
                )
            )
        false = per_hour(modelled.count[:, k], modelled.hours, modelled.recording, "cues")
        lines.append(Line(f"{words}: false cues", "1/h", None, false))
    for weight, winner, wins, sure in zip(*choice.winners[:3], choice.winners.sure, strict=True):
        mm, wins_often = (
            faulty.cues[choice.sets[winner]].threshold_mm,
            f"wins {100 * wins[winner]:.0f} % of resamples",
        )
        threshold = StudyEstimate(
            mm if sure else np.nan,
            *_range([faulty.cues[k].threshold_mm for k in choice.sets], wins),
            of=wins_often if sure else f"cannot be said: {mm:g} mm {wins_often}",
        )
        lines.append(
            Line(
                f"threshold chosen where a missed unintended motion an hour weighs {weight:,.0f}"
                " false cues",
                "mm",
                None,
                threshold,
            )
        )
    return lines


def _range(values: Sequence[float], wins: np.ndarray) -> tuple[float, float]:
    """Between which values 95 % of the resamples chose."""
    below = np.cumsum(wins)
    low, high = (int(np.searchsorted(below, end - 1e-9)) for end in (0.025, 0.975))
    return values[low], values[min(high, len(values) - 1)]


def _notes(faulty: FaultyCues, modelled: FreeCues) -> tuple[str, ...]:
    return (
        (
            f"Unintended motion: {events.meaning('unintended_motion', faulty.rules)}. A cue at that"
            " distance of the reported tip from the model, or beyond, is no warning of it: the"
            " motion begins at that distance from the same model. Only of lower thresholds is it a"
            " finding whether they come before it. What the choice hangs on asks again for motion"
            " that could injure and for jumps of the true tip alone."
        ),
        (
            "An unintended motion counts as missed where the cue never came, or the golden run had"
            " it by then: a surgeon who feels it in normal motion, too, learns nothing from it."
        ),
        (
            f"False cues: separate pulses in {modelled.hours.sum():.1f} h of generated motion, of"
            f" {len(np.unique(modelled.recording))} recordings at four scales each. A pulse that"
            " flickers about the threshold counts each time, one that stays counts once: after a"
            " minute of clutching the cue pulls on and on, which the time with one tells. Real"
            " motion has tails that a generated one lacks, and a real robot is not its own model."
        ),
        (
            "The weight of a missed unintended motion holds two things that no source tells: how"
            " many false cues it is worth, and how many of them come in an hour. The choice is"
            " therefore shown over six decades, not made."
        ),
        (
            "Which faults there are is a design: the library's own values and sampled ones about"
            " the boundary of unintended motion. Another mix would move the share missed, and so"
            " the choice."
        ),
        kinds.NOTE,
        (
            "Gains change how strongly a cue is felt, and when only through the damper: where the"
            " robot closes in fast enough that the pull would be negative there is no cue. Nobody"
            " reacts to the cue here."
        ),
    )


def _variants() -> tuple[Variant, ...]:
    return (
        *motions_alike.faulty(CAMPAIGN),
        *(
            motions_alike.fault_free(
                CAMPAIGN, motion, seed, FREE_RUNS, FREE_S, "How often is there a cue for nothing?"
            )
            for motion, seed in RECORDINGS
        ),
    )


STUDY = Study(
    name="haptic_cue",
    title="At which distance should the haptic cue pull, and how strongly?",
    source="a study of our own; the cue of IROS 2016, 3 mm and a cap of 0.05",
    question=(
        "What is felt of which fault, when, how strongly, how often for nothing, and which"
        " threshold would the data choose?"
    ),
    variants=_variants(),
    compare=compare,
    minutes=2.0,
)

"""What the raw table of a generated campaign says, in plain pandas."""

from __future__ import annotations

import functools
from fractions import Fraction

import naive_facts
import pandas as pd
import plain_statistics as plain
from generated_campaigns import Campaign
from page_text import number


class Expected:
    """What the raw table says. `faults`: one valid run of each fault in which nobody reacts, raw
    columns and facts.
    """

    def __init__(self, campaign: Campaign) -> None:
        self.frame, self.manifest, self.plan = campaign.frame, campaign.manifest, campaign.plan
        usual = ("none", "release", "slow").index(self.plan.usual) if self.plan.actions else 0
        self.facts = naive_facts.derive(self.frame, self.plan.verdict_cue, self.plan.jump, usual)
        raw = self.frame.drop(
            columns=["verdict", *(name for name in self.facts if name in self.frame)]
        )
        self.all = raw.join(self.facts)
        self.faults = self.all[self.all["sample"] & self.all["faulty"]]
        self.motions = naive_facts.motions(self.frame, self.facts["plain"])
        self.hours = self.motions["golden_pedal_down_ms"].sum() / 3.6e6
        self.end = self.plan.duration_ms
        self.limit = f"{number(self.plan.limit_mm, 6)} mm"
        self.threshold = f"{number(self.plan.thresholds[self.plan.verdict_cue], 6)} mm"

    @property
    def n(self) -> int:
        """Distinct faults with a valid outcome."""
        return len(self.faults)

    @property
    def repeats(self) -> int:
        """Further valid runs of these faults."""
        every = self.all
        return self.count(every["faulty"] & every["plain"] & ~every["failed"]) - self.n

    @property
    def false_cues(self) -> int:
        """Fault-free motions with the cue of the verdicts."""
        return self.count(self.motions[f"golden_cue{self.plan.verdict_cue}_first_ms"] >= 0)

    def first_cues(self, k: int) -> tuple[int, float]:
        """Fault-free motions with a cue, and the hours in pedal-down, spread evenly, until the
        first one of each.
        """
        first = self.motions[f"golden_cue{k}_first_ms"]
        share = (first / self.end).where(first >= 0, 1.0)
        return (
            self.count(first >= 0),
            float((self.motions["golden_pedal_down_ms"] * share).sum()) / 3.6e6,
        )

    def false_alarms(self, d: int, threshold: float) -> tuple[int, float]:
        """Fault-free motions with an alarm, and the hours of all: when it came is not known."""
        return self.count(self.motions[f"golden_detector{d}_score"] > threshold), self.hours

    def leads(self, k: int) -> bool:
        """Whether cue k fires below the limit: else the definitions decide that it does not come
        before the motion.
        """
        return self.plan.thresholds[k] < self.plan.limit_mm

    @staticmethod
    def count(chosen: pd.Series) -> int:
        """How many are true."""
        return int(chosen.sum())

    def quiet(self) -> dict[str, float]:
        """The lowest threshold of each detector that no fault-free motion exceeds; none where
        each is exceeded.
        """
        found = {}
        for d, detector in enumerate(self.manifest.detectors):
            able = [
                threshold
                for threshold in detector.thresholds
                if threshold >= self.motions[f"golden_detector{d}_score"].max()
            ]
            if able:
                found[detector.name] = min(able)
        return found

    def known(self, faults: pd.DataFrame, before: bool = False) -> list[int]:
        """When anyone could first know of each fault: a check that tells, the cue, a quiet
        detector; -1: never.

        before: without a cue or a tip error at the limit of hazards or beyond, which is no warning
        of the motion.
        """
        columns = (
            ["told_ms", "warned_ms"]
            if not before or self.leads(self.plan.verdict_cue)
            else ["told_ms"]
        )
        for d, detector in enumerate(self.manifest.detectors):
            beyond = (
                detector.kind == "tip_error"
                and self.quiet().get(detector.name, 0.0) >= self.plan.limit_mm
            )
            if detector.name in self.quiet() and not (before and beyond):
                columns.append(
                    f"detector{d}_threshold{detector.thresholds.index(self.quiet()[detector.name])}_first_ms"
                )
        times = zip(faults["first_active_ms"], faults[columns].to_numpy().tolist(), strict=True)
        return [min((ms for ms in row if ms >= max(onset, 0)), default=-1) for onset, row in times]

    @staticmethod
    def earliest(one: list[int], other: list[int]) -> list[int]:
        """The first of two alarms of each fault; -1: neither came."""
        return [
            min((ms for ms in pair if ms >= 0), default=-1) for pair in zip(one, other, strict=True)
        ]

    def after(self, alarm: pd.Series, faults: pd.DataFrame) -> list[int]:
        """An alarm of each fault, -1 where it came before the fault did anything."""
        pairs = zip(alarm.loc[faults.index], faults["first_active_ms"], strict=True)
        return [int(ms) if ms >= max(onset, 0) else -1 for ms, onset in pairs]

    def delay(
        self, alarm: list[int], faults: pd.DataFrame, share: Fraction = Fraction(1, 2)
    ) -> plain.Known:
        """When this share of faults had the alarm, after the first effect."""
        return self._came_by(alarm, faults["first_active_ms"], share)

    def lead(self, alarm: list[int], faults: pd.DataFrame) -> plain.Known:
        """Median of how long before the unintended motion the alarm came."""
        value, low, high = self._came_by(alarm, faults["unintended_first_ms"], Fraction(1, 2))
        return -value, -high, -low

    def _came_by(self, alarm: list[int], start: pd.Series, share: Fraction) -> plain.Known:
        times = [
            int((ms if ms >= 0 else self.end) - first)
            for ms, first in zip(alarm, start, strict=True)
        ]
        return plain.came_by(times, [ms >= 0 for ms in alarm], share)

    def before(self, alarm: list[int], faults: pd.DataFrame) -> int:
        """In how many the alarm came before the unintended motion."""
        return sum(
            0 <= ms < motion
            for ms, motion in zip(alarm, faults["unintended_first_ms"], strict=True)
        )

    @functools.cached_property
    def pairs(self) -> dict[int, pd.DataFrame]:
        """By action: runs with it beside the run of the same pair without a reaction (columns
        with suffix _alone).
        """
        if "param:reaction.action" not in self.frame or not (self.all["action"] == 0).any():
            return {}
        valid = self.all[self.all["faulty"] & ~self.all["failed"]]
        crossed = [name for name in ("param:plant.friction_scale",) if self.plan.crossed_robot]
        found = {}
        for action in sorted(set(self.all["action"]) - {0}):
            mine, alone = (valid[valid["action"] == a] for a in (action, 0))
            both = mine.merge(alone, on=["pair", *crossed], suffixes=("", "_alone"))
            both = both.drop_duplicates(["distinct", *crossed])
            if len(both):
                found[action] = both
        return found


def untold(part: pd.DataFrame) -> pd.Series:
    """Runs of which no check told anyone."""
    return part["response"].isin(["silent", "limited"])


def evades(part: pd.DataFrame) -> tuple[int, int]:
    """How many evade, of how many."""
    return int((untold(part) & (part["hazard"] == "unintended motion")).sum()), len(part)


def moves(part: pd.DataFrame) -> tuple[int, int]:
    """How many make an unintended motion, of how many."""
    return int((part["hazard"] == "unintended motion").sum()), len(part)


def largest_first(hits: tuple[int, int]) -> tuple[bool, float]:
    """To sort shares by: the largest first, one of nothing last."""
    k, n = hits
    return not n, -k / n if n else 0.0


def in_pairs(both: pd.DataFrame) -> tuple:
    """Whether the run without and the run with the reaction of each pair made an unintended
    motion, bool [pairs].
    """
    return tuple(
        (both[name] == "unintended motion").to_numpy() for name in ("hazard_alone", "hazard")
    )


def mean_far(both: pd.DataFrame) -> float:
    """Mean change of how far the tip went by itself."""
    names = ("unintended_mm", "unintended_off_mm")
    far, alone = (both[[name + end for name in names]].max(axis=1) for end in ("", "_alone"))
    return float((far - alone).mean())

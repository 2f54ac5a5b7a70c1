"""Finds the checks that would have detected evading faults, and confirms them in a new run."""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax import consent
from ravenjax.analyses.monitors import scores
from ravenjax.analyses.monitors.counterfactual import candidates, observation
from ravenjax.analyses.monitors.counterfactual.candidates import (
    MARGINS,
    PROPOSED,
    Candidate,
    Question,
)
from ravenjax.analyses.monitors.counterfactual.promise import (
    Grounds,
    Promise,
    false_alarm_rate,
    join_scores,
)
from ravenjax.campaign import loading, runner
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress import OnProgress
from ravenjax.errors import UserError, describe_unknown_name
from ravenjax.report import wording
from ravenjax.report.data import draws
from ravenjax.stats.intervals import Estimate, Rate, rate_difference, wilson_interval

TIP_ERROR = "tip_error_bound"
"""Name of the candidate that equals the built-in detector `tip_error`, if there is one."""


class Member(NamedTuple):
    """One check of the selected set, with results on the faults and motions for the statement."""

    place: int  # index among all candidates
    sees: float  # share of the faults that the check detects
    adds: float  # share that the check detects and no earlier check of the set detects
    lead_ms: float  # median lead time over the detected faults; NaN if it detects none
    false_alarms: int


class Counterfactual(NamedTuple):
    """The result of `ravenjax counterfactual`. A Promise has coverage and false alarms of a set."""

    question: Question
    config: CampaignConfig
    parts: tuple[Candidate, ...]  # all candidates
    grounds: Grounds
    promise: Promise  # of the selected set
    alone: tuple[Promise, ...]  # of each candidate alone
    best: Promise  # of the single candidate that covers most faults of the selection half
    tip_error: Promise | None  # of the built-in detector of the tip error
    everything: Promise  # of all candidates together
    # Share of the faults that each random set of the same size covers.
    random: np.ndarray
    # Share of the faults that are covered by a set that was selected without the fault's group;
    # None if there is only one group.
    strangers: Rate | None
    scale_hours: float  # hours of fault-free motion that determine the scales

    @property
    def members(self) -> list[Member]:
        """Return the checks of the set, with the set's margin, in the order of selection."""
        grounds, margin = self.grounds, self.promise.margin
        # Time from the alarm to the harm, ms [faults, members].
        lead = grounds.hazards.lead_ms[grounds.statement_half][
            :, self.promise.members, margin.place
        ]
        covered = lead >= self.question.lead_ms
        fresh = covered & (np.cumsum(covered, axis=1) == covered)
        return [
            Member(
                candidate,
                float(covered[:, number].mean()),
                float(fresh[:, number].mean()),
                (
                    float(np.median(lead[covered[:, number], number]))
                    if covered[:, number].any()
                    else float("nan")
                ),
                false_alarm_rate(join_scores(grounds.statement, [candidate]), margin.value).count,
            )
            for number, candidate in enumerate(self.promise.members)
        ]

    @property
    def uncovered(self) -> list[tuple[str, int, int]]:
        """Return (group, missed faults, all faults) of the half for the statement, with the most
        missed faults first.
        """
        rows = self.grounds.statement_half
        hit = self.grounds.covered(self.promise.members)[rows]
        group = self.grounds.hazards.group[rows]
        out = [
            (str(name), int((~hit[group == name]).sum()), int((group == name).sum()))
            for name in np.unique(group)
        ]
        return sorted((one for one in out if one[1]), key=lambda one: (-one[1], one[0]))


def find_checks(
    config: CampaignConfig,
    question: Question,
    engine: str = "auto",
    on_stage: Callable[[str], None] = lambda _: None,
    on_progress: OnProgress | None = None,
) -> Counterfactual:
    """Find a set of checks for the evading faults of a campaign.

    Raise UserError if no fault evades or no candidate detects a fault in time.
    """
    question.require()
    names = [group.name for group in config.group]
    for group in question.groups:
        if group not in names:
            raise UserError(describe_unknown_name("--group", group, names))
    raw: dict[str, Any] = config.model_dump(mode="json")
    every = scores.list_candidates(config.robot)
    course = observation.plan_motions(raw, question.hours)
    observation.require_rate(question.false_alarms_per_hour, course)
    # A motion is a single run, which a CPU core computes faster than a GPU.
    motion_engine = "simd" if engine in ("auto", "cuda") else engine
    with (
        tempfile.TemporaryDirectory(prefix="ravenjax_candidates_") as name,
        consent.given_for(Path(name)),
    ):
        folder = Path(name)

        def motion(
            purposes: tuple[str, ...], parts: list[Candidate], part: str
        ) -> observation.FreeMotion:
            # Runs the fault-free motions that are reserved for `purposes`, with these candidate
            # detectors.
            numbers = [
                n
                for purpose in purposes
                for n in observation.motions_by_use(purpose, course.motions)
            ]
            return observation.run_motions(
                raw, course, numbers, parts, folder / part, motion_engine
            )

        on_stage(
            f"scales of the candidates: a quarter of {course.motions} fault-free motions of"
            f" {course.seconds} s"
        )
        pilot = motion(("scales",), candidates.single_channels(every), "singles")
        parts = candidates.scale_candidates(every, pilot.peaks.max(axis=(0, 1)))
        on_stage(f"false alarms of {len(parts)} candidates: the other fault-free motions")
        free = motion(("calibrated", "stated"), parts, "scaled")
        first = len(observation.motions_by_use("calibrated", course.motions))
        calibration, statement = (
            observation.FreeMotion(free.peaks[some], free.hours[some])
            for some in (slice(first), slice(first, None))
        )
        on_stage(f"runs of the campaign, with all candidates at {len(MARGINS)} margins")
        there = observation.run_hazards(
            raw, parts, MARGINS, folder / "scaled", engine, question.groups, on_progress
        )
    halves = there.halves(question.seed)
    grounds = Grounds(question, calibration, statement, there, *halves)
    members = grounds.selected()
    _require_cover(grounds, members)
    singles = tuple(grounds.promise([candidate]) for candidate in range(len(parts)))
    named = {part.name: promise for part, promise in zip(parts, singles, strict=True)}
    return Counterfactual(
        question,
        config,
        tuple(parts),
        grounds,
        grounds.promise(members),
        singles,
        max(singles, key=lambda promise: promise.selected.value),
        named.get(TIP_ERROR),
        grounds.promise(range(len(parts))),
        grounds.at_random(len(members)),
        grounds.of_strangers(),
        float(pilot.hours.sum()),
    )


def _require_cover(grounds: Grounds, members: list[int]) -> None:
    # Without faults in both halves, or without a candidate in time, there is no set to select.
    for task, rows in (("select", grounds.selection_half), ("test", grounds.statement_half)):
        if not rows.any():
            raise UserError(
                f"only {grounds.hazards.count} faults evade the robot's checks, too few to"
                f" {task} a set of checks: compute more runs"
            )
    if not members:
        raise UserError(
            f"no candidate raises an alarm {grounds.question.lead_ms} ms before harm in any of"
            f" {int(grounds.selection_half.sum())} faults, with a threshold of"
            f" {MARGINS[PROPOSED]:g} times the largest score in fault-free motion. Write a shorter"
            " --lead-ms"
        )


class Confirmation(NamedTuple):
    """Detected faults in a run of `chosen/campaign.toml` with another seed."""

    seed: int
    every: Rate  # share of all evading faults
    anew: Rate  # share of the faults of groups that draw their faults
    promised: Rate  # share of the faults of these groups in the half for the statement
    draws: bool  # True if any group draws its faults
    # `anew` minus `promised`; without an interval if robots were drawn, or no faults.
    difference: Estimate

    @property
    def verdict(self) -> str:
        """Return "as", "more than" or "less than", compared with the statement before; "" if there
        is no interval.
        """
        if math.isnan(self.difference.low):
            return ""
        if self.difference.low > 0:
            return "more than"
        return "less than" if self.difference.high < 0 else "as"

    @property
    def sentence(self) -> str:
        """Return the result as a sentence."""
        template = wording.text_templates(__package__).get_template("confirmation.txt.j2")
        return template.render(one=self).strip()


def confirm_checks(
    one: Counterfactual,
    file: Path,
    seed: int,
    engine: str = "auto",
    on_progress: OnProgress | None = None,
) -> Confirmation:
    """Run the campaign that `output` wrote, with another seed. Raises UserError."""
    config = loading.load_campaign(file, [f"campaign.seed={seed}"])
    table = runner.run_campaign(config, None, engine, on_progress=on_progress).frame()
    rules = observation.campaign_choices(config)
    rows, harm = observation.evading_faults(table, rules, one.question.groups)
    evading = table.loc[rows]
    # The last detectors of the campaign are the checks of the set.
    numbers = range(len(config.detectors) - len(one.promise.members), len(config.detectors))
    leads = [
        observation.detector_leads(evading, f"detector{n}_", config.detectors[n][2], harm)
        for n in numbers
    ]
    in_time = np.max(leads, axis=0)[:, 0] >= one.question.lead_ms
    sampled = list(draws.drawn_groups(config.model_dump(mode="json")) or ())
    new = evading["group"].astype(str).isin(sampled).to_numpy()
    drawn = one.grounds.statement_half & one.grounds.hazards.sampled
    promised = _rate(one.grounds.covered(one.promise.members)[drawn])
    anew = _rate(in_time[new])
    gap = rate_difference(anew.k, anew.n, promised.k, promised.n)
    if one.grounds.hazards.robots:
        gap = Estimate(gap.value)
    return Confirmation(seed, _rate(in_time), anew, promised, bool(sampled), gap)


def _rate(hit: np.ndarray) -> Rate:
    return wilson_interval(int(hit.sum()), len(hit))

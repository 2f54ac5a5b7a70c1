"""Finds checks that would detect evading faults, and runs the campaign again with these checks."""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax import consent
from ravenjax.analyses.monitors import scores
from ravenjax.analyses.monitors.counterfactual import observation
from ravenjax.analyses.monitors.counterfactual.candidates import (
    MARGINS,
    SELECTION_MARGIN_INDEX,
    Candidate,
    Question,
    list_single_channels,
    scale_candidates,
)
from ravenjax.analyses.monitors.counterfactual.check_set import (
    CheckSet,
    Evidence,
    false_alarm_rate,
    join_scores,
)
from ravenjax.campaign import loading, runner
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress import OnProgress
from ravenjax.engines import selection
from ravenjax.errors import UserError, describe_unknown_name
from ravenjax.report import wording
from ravenjax.report.data import draws
from ravenjax.stats.intervals import Estimate, Rate, rate_difference, wilson_interval

TIP_ERROR = "tip_error_bound"
"""Name of the candidate that equals the built-in detector `tip_error`, if there is one."""


class SelectedCheck(NamedTuple):
    """One check of the selected set, with its results on the test half and the test motions."""

    index: int  # among all candidates
    detected_share: float  # share of the faults that the check detects in time
    # Share of the faults that the check detects in time and no earlier check of the set does.
    added_share: float
    lead_ms: float  # median lead time over the detected faults; NaN if it detects none
    false_alarms: int


class Counterfactual(NamedTuple):
    """The result of `ravenjax counterfactual`: sets of checks with coverage and false alarms."""

    question: Question
    config: CampaignConfig
    candidates: tuple[Candidate, ...]
    evidence: Evidence
    selected_set: CheckSet
    single_sets: tuple[CheckSet, ...]  # each candidate alone
    best_single_set: CheckSet  # the candidate that covers most faults of the selection half
    tip_error_set: CheckSet | None  # the built-in detector of the tip error
    full_set: CheckSet  # all candidates together
    random_coverages: np.ndarray  # share of the faults that each random set of this size covers
    # Share of faults that a set covers that was selected without their group; None for one group.
    new_group_coverage: Rate | None
    scale_hours: float  # hours of fault-free motion that determine the scales

    @property
    def selected_checks(self) -> list[SelectedCheck]:
        """The checks of the set, with the set's margin, in the order of selection."""
        evidence, margin = self.evidence, self.selected_set.margin
        test_lead_ms = evidence.faults.lead_ms[evidence.test_half]
        # Time from the alarm to the harm, ms [faults, checks of the set].
        lead_ms = test_lead_ms[:, self.selected_set.indices, margin.index]
        detected = lead_ms >= self.question.lead_ms
        # A check adds a fault if no earlier check of the set detects it: the count becomes 1 there.
        added = detected & (np.cumsum(detected, axis=1) == 1)
        checks = []
        for column, index in enumerate(self.selected_set.indices):
            detected_lead_ms = lead_ms[detected[:, column], column]
            motions = join_scores(evidence.test_motions, [index])
            check = SelectedCheck(
                index=index,
                detected_share=float(detected[:, column].mean()),
                added_share=float(added[:, column].mean()),
                lead_ms=float(np.median(detected_lead_ms)) if len(detected_lead_ms) else math.nan,
                false_alarms=false_alarm_rate(motions, margin.value).count,
            )
            checks.append(check)
        return checks

    @property
    def missed_groups(self) -> list[tuple[str, int, int]]:
        """The groups with faults of the test half that the set does not detect in time.

        Each tuple is (group, missed faults, all faults), with the most missed faults first.
        """
        rows = self.evidence.test_half
        detected = self.evidence.detects_in_time(self.selected_set.indices)[rows]
        group = self.evidence.faults.group[rows]
        missed_groups = []
        for name in np.unique(group):
            missed_count = int((~detected[group == name]).sum())
            if missed_count:
                missed_groups.append((str(name), missed_count, int((group == name).sum())))
        return sorted(missed_groups, key=lambda missed: (-missed[1], missed[0]))


def find_checks(
    config: CampaignConfig,
    question: Question,
    engine: str = "auto",
    on_stage: Callable[[str], None] = lambda _: None,
    on_progress: OnProgress | None = None,
) -> Counterfactual:
    """Find a set of checks for the evading faults of a campaign.

    `on_stage` is called with a description of each stage: fault-free motions for the scales of the
    candidates, fault-free motions for their false alarms, and the runs of the campaign. Raise
    UserError if no fault evades or no candidate detects a fault in time.
    """
    question.require()
    names = [group.name for group in config.group]
    for group in question.groups:
        if group not in names:
            raise UserError(describe_unknown_name("--group", group, names))
    raw: dict[str, Any] = config.model_dump(mode="json")
    candidate_scores = scores.list_candidates(config.robot)
    schedule = observation.plan_motions(raw, question.hours)
    observation.require_rate(question.false_alarms_per_hour, schedule)
    motion_engine = selection.single_run_engine(engine)
    with (
        tempfile.TemporaryDirectory(prefix="ravenjax_candidates_") as name,
        consent.trust_folders(Path(name)),
    ):
        channel_folder, candidate_folder = Path(name) / "channels", Path(name) / "candidates"

        def run_motions(use: str, checks: list[Candidate], folder: Path) -> observation.FreeMotion:
            # Runs the fault-free motions that are reserved for one use, with these detectors.
            return observation.run_motions(raw, schedule, use, checks, folder, motion_engine)

        on_stage(
            f"scales of the candidates: a quarter of {schedule.motions} fault-free motions of"
            f" {schedule.seconds} s"
        )
        channels = list_single_channels(candidate_scores)
        scale_motions = run_motions("scales", channels, channel_folder)
        candidates = scale_candidates(candidate_scores, scale_motions.peaks.max(axis=(0, 1)))
        on_stage(f"false alarms of {len(candidates)} candidates: the other fault-free motions")
        calibration_motions = run_motions("calibration", candidates, candidate_folder)
        test_motions = run_motions("test", candidates, candidate_folder)
        on_stage(f"runs of the campaign, with all candidates at {len(MARGINS)} margins")
        faults = observation.run_evading_faults(
            raw, candidates, MARGINS, candidate_folder, engine, question.groups, on_progress
        )
    halves = faults.halves(question.seed)
    evidence = Evidence(question, calibration_motions, test_motions, faults, *halves)
    indices = evidence.select_set()
    _require_cover(evidence, indices)
    single_sets = tuple(evidence.assess([index]) for index in range(len(candidates)))
    names = [candidate.name for candidate in candidates]
    set_by_name = dict(zip(names, single_sets, strict=True))
    return Counterfactual(
        question=question,
        config=config,
        candidates=tuple(candidates),
        evidence=evidence,
        selected_set=evidence.assess(indices),
        single_sets=single_sets,
        best_single_set=max(single_sets, key=lambda single: single.selection_coverage.value),
        tip_error_set=set_by_name.get(TIP_ERROR),
        full_set=evidence.assess(range(len(candidates))),
        random_coverages=evidence.random_set_coverages(len(indices)),
        new_group_coverage=evidence.coverage_of_new_groups(),
        scale_hours=float(scale_motions.hours.sum()),
    )


def _require_cover(evidence: Evidence, indices: list[int]):
    """Raise UserError if a half has no faults, or if the selected set `indices` is empty."""
    halves = {"select": evidence.selection_half, "test": evidence.test_half}
    for task, rows in halves.items():
        if not rows.any():
            raise UserError(
                f"only {evidence.faults.count} faults evade the robot's checks, too few to"
                f" {task} a set of checks: compute more runs"
            )
    if not indices:
        raise UserError(
            f"no candidate raises an alarm {evidence.question.lead_ms} ms before harm in any of"
            f" {int(evidence.selection_half.sum())} faults, with a threshold of"
            f" {MARGINS[SELECTION_MARGIN_INDEX]:g} times the largest score in fault-free motion."
            " Write a shorter --lead-ms"
        )


class Confirmation(NamedTuple):
    """Detected faults in a run of `chosen/campaign.toml` with another seed."""

    seed: int
    all_faults: Rate  # share of all evading faults
    drawn_faults: Rate  # share of the faults of groups that draw their faults
    test_half: Rate  # share of the faults of these groups in the test half, with the first seed
    has_drawn_groups: bool  # True if any group draws its faults
    # `drawn_faults` minus `test_half`; without an interval if robots were drawn, or no faults.
    difference: Estimate

    @property
    def verdict(self) -> str:
        """Compares detected shares. This seed's share is "more than", "less than" or "as" (no
        different from) the first seed's, in the test half; "" if the difference has no interval.
        """
        if math.isnan(self.difference.low):
            return ""
        if self.difference.low > 0:
            return "more than"
        return "less than" if self.difference.high < 0 else "as"

    @property
    def sentence(self) -> str:
        """The result as a sentence."""
        template = wording.text_templates(__package__).get_template("confirmation.txt.j2")
        return template.render(confirmation=self).strip()


def confirm_checks(
    found: Counterfactual,
    file: Path,
    seed: int,
    engine: str = "auto",
    on_progress: OnProgress | None = None,
) -> Confirmation:
    """Run the campaign `file`, which has the selected checks as detectors, with another seed, and
    compare the detected share with that of the test half.

    Raise UserError if the campaign cannot be loaded.
    """
    config = loading.load_campaign(file, [f"campaign.seed={seed}"])
    results = runner.run_campaign(config, None, engine, on_progress=on_progress)
    evading = observation.read_evading_faults(results, found.question.groups)
    # The last detectors of the campaign are the checks of the set. Each has one threshold.
    check_count = len(found.selected_set.indices)
    lead_ms = []
    for number in range(len(config.detectors) - check_count, len(config.detectors)):
        thresholds = config.detectors[number][2]
        prefix = f"detector{number}_"
        lead_ms.append(observation.detector_leads(evading, prefix, thresholds)[:, 0])
    in_time = np.max(lead_ms, axis=0) >= found.question.lead_ms
    # Only faults that are drawn differ between the two seeds.
    drawn_groups = list(draws.drawn_groups(config.model_dump(mode="json")) or ())
    is_drawn = evading["group"].astype(str).isin(drawn_groups).to_numpy()
    evidence = found.evidence
    before = evidence.detects_in_time(found.selected_set.indices)
    drawn_faults = _rate(in_time[is_drawn])
    test_half = _rate(before[evidence.test_half & evidence.faults.sampled])
    difference = rate_difference(drawn_faults.k, drawn_faults.n, test_half.k, test_half.n)
    if evidence.faults.units_are_robots:
        # Faults of one robot are not independent, so the interval over faults is not valid.
        difference = Estimate(difference.value)
    return Confirmation(
        seed=seed,
        all_faults=_rate(in_time),
        drawn_faults=drawn_faults,
        test_half=test_half,
        has_drawn_groups=bool(drawn_groups),
        difference=difference,
    )


def _rate(detected: np.ndarray) -> Rate:
    return wilson_interval(int(detected.sum()), len(detected))

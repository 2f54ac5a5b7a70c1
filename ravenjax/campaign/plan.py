"""A validated campaign made ready to run: its fault table, what picks code, and plain arrays with one row a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign.faults import design, run_id, table
from ravenjax.campaign.file import loading
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.engines.interface import TickProgram
from ravenjax.faults.fault import Fault, Faults
from ravenjax.numbers import paths
from ravenjax.numbers.setup import CAMPAIGN, Precision
from ravenjax.numbers.vec import replace
from ravenjax.robots.raven2.arms import ARMS, JOINTS
from ravenjax.robots.raven2.console import motions
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.robots.raven2.geometry import limits
from ravenjax.robots.raven2.loop import tick
from ravenjax.robots.raven2.setup import Setup
from ravenjax.robots.raven2.stages import overdrive
from ravenjax.store.motion import replay as recorded
from ravenjax.store.motion.reach import Bounds
from ravenjax.store.motion.replay import OperatorReplay
from ravenjax.store.motion.summary import MotionSummary
from ravenjax.vocabulary.reactions import ACTIONS

POLICIES = {
    "no_regulation": overdrive.NO_REGULATION,
    "soft_regulation": overdrive.SOFT_REGULATION,
    "hard_regulation": overdrive.HARD_REGULATION,
}
NOISE_KEY = "plant.noise_key"
"""Parameter that a campaign with noise sets from each run's id, which hashes its seed: every run draws its own."""

SCALE = "operator.scale"
"""Parameter that makes a tip move more or less far than the hands' motion was made for."""

DELAY, LONGEST_DELAY = "usb.command_delay", 16
"""Parameter that makes the tick keep commands of the past, and the most it keeps, ms."""


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """Everything that a campaign computes, before anything is compiled."""

    config: CampaignConfig
    table: pd.DataFrame  # the fault table, one row a run
    program: TickProgram
    motion: Motion
    operator: MotionSummary | None  # what became of a recorded one
    columns: tuple[np.ndarray, ...]  # the motion's columns, float32 [ticks]
    faults: dict[str, np.ndarray]  # as table.arrays, [runs, slots]
    varied: dict[str, np.ndarray]  # path -> [runs]
    twin: np.ndarray  # int32 [runs], number of the golden run, as they come; runs that share one share its number

    @property
    def runs(self) -> int:
        """Rows of the fault table."""
        return len(self.table)

    def lanes(
        self, rows: Sequence[int] | np.ndarray, lanes: int, harmless: bool = False
    ) -> tuple[dict[str, Any], Faults]:
        """Varied parameters and faults of a block: `rows`, the last repeated to fill it; `harmless`: without faults."""
        index = np.asarray(rows)[np.minimum(np.arange(lanes), len(rows) - 1)]
        varied = {path: values[index] for path, values in self.varied.items()}
        picked = {name: values[index] for name, values in self.faults.items()}
        if harmless:
            picked["code"] = np.zeros_like(picked["code"])
        slots = range(self.program.setup.injection.slots)
        return varied, Faults(
            tuple(Fault(**{name: values[:, slot] for name, values in picked.items()}) for slot in slots)
        )


def make(config: CampaignConfig, precision: Precision = CAMPAIGN) -> Plan:
    """Plan a campaign. Raises UserError for what cannot be run."""
    rows = design.expand(config)
    varied = table.parameters(rows)
    replay = operator_replay(config)
    motion = operator_motion(config) if replay is None else replay.motion
    injection = table.injection(rows)
    setup = Setup(
        arms=config.campaign.arms,
        software=config.campaign.software,
        tools=config.tools,
        build=config.campaign.build,
        console=config.campaign.console,
        dac_words=config.campaign.stored_words,
        precision=precision,
        substeps=config.campaign.substeps,
        injection=injection,
        cues=len(config.haptics.cues()),
        command_delay=_longest(varied.get(DELAY)),
        detectors=tuple(use for _, use, _ in config.detectors),
        reacts=config.reaction is not None,
        noise=config.campaign.noise,
    )
    params = _params(config, setup, motion)
    loading.check_parameters(config, known_parameters(params, setup))
    values = _filled(varied, params, setup)
    if setup.noise:
        values[NOISE_KEY] = run_id.stream(table.shared_ids(rows), "noise")
    return Plan(
        config=config,
        table=rows,
        program=TickProgram(tick, setup, params, tuple(values), config.campaign.ticks),
        motion=motion,
        operator=None if replay is None else _scaled(replay, varied.get(SCALE)),
        columns=tuple(np.ascontiguousarray(column) for column in motion.table().T),
        faults=table.arrays(rows, injection),
        varied=values,
        twin=_twins(values, len(rows)),
    )


def _longest(delays: np.ndarray | None) -> int:
    """Room that the delay line needs, ms: one for each tick of the longest delay that can be run."""
    if delays is None or np.isnan(delays).all():
        return 0
    return int(np.clip(np.nanmax(delays), 0, LONGEST_DELAY))


def operator_replay(config: CampaignConfig, ticks: int | None = None) -> OperatorReplay | None:
    """What becomes of a recorded operator in `ticks` ms, by default those of a run; None for a generated motion.

    Raises UserError for a file that cannot be used as the campaign has it.
    """
    operator = config.operator
    if operator.file is None:
        return None
    ticks, bounds = ticks or config.campaign.ticks, operator_bounds(config)
    return recorded.replay(operator.file, config.campaign.arms, operator.options, ticks, operator.scale, bounds)


def operator_bounds(config: CampaignConfig) -> Bounds:
    """Soft limits of the positioning joints, the roll and the wrist in a campaign."""
    soft = limits.soft_limits(config.tools[0], config.campaign.software)
    own = config.limits.si()
    pairs = zip(JOINTS, zip(soft.lower[:5], soft.upper[:5], strict=True), strict=False)
    lower, upper = zip(*(own.get(joint, pair) for joint, pair in pairs), strict=True)
    return Bounds(lower, upper)


def _scaled(replay: OperatorReplay, scales: np.ndarray | None) -> MotionSummary:
    """The summary of a replay whose teleoperation scale a campaign varies; UserError where that leaves the limits."""
    if scales is None or np.isnan(scales).all():
        return replay.summary
    some = np.where(np.isnan(scales), replay.summary.scale, scales)
    recorded.require_scales(replay, some)
    return replay.summary.model_copy(update={"scales": (float(some.min()), float(some.max()))})


def operator_motion(config: CampaignConfig) -> Motion:
    """The operator's motion, one row a tick of the run."""
    operator, arms = config.operator, config.campaign.arms
    if (replay := operator_replay(config)) is not None:
        return replay.motion
    name = operator.motion or "suture"
    generated = motions.generate(name, config.campaign.duration_s, arms, operator.seed).first(config.campaign.ticks)
    start = operator.start.si()
    begins = (
        tuple(start.get(joint, q) for joint, q in zip(JOINTS, jpos, strict=True)) for jpos in generated.start_jpos
    )
    return dataclasses.replace(generated, start_jpos=tuple(begins))


def known_parameters(params: Any, setup: Setup) -> list[str]:
    """Every path that a campaign may vary: full ones, without the arm, and of whole vectors."""
    known: dict[str, None] = {}
    for full, _ in paths.leaves(params, setup):
        if full.startswith("start."):
            continue  # where a run begins is the motion's
        for path in (full, paths.shorten(full, ARMS)):
            known[path] = None
            head, _, last = path.rpartition(".")
            if last in paths.components(JOINTS):
                known[head] = None
    return list(known)


def _params(config: CampaignConfig, setup: Setup, motion: Motion) -> tick.Params:
    params = tick.params(setup, motion.start_jpos, config.campaign.parameter_set)
    operator = replace(params.operator, scale=config.operator.scale)
    level, policy = config.campaign.level, POLICIES[config.campaign.policy]
    control = replace(params.control, overdrive=overdrive.params(setup, level, policy))
    cues = tuple(
        replace(cue, threshold_m=new.threshold_m, kp=new.kp, kd=new.kd, cap=new.cap)
        for cue, new in zip(params.haptics.cues, config.haptics.cues(), strict=True)
    )
    params = replace(params, operator=operator, control=control, haptics=replace(params.haptics, cues=cues))
    observer = replace(
        params.monitor,
        limit=config.outcomes.limit_mm / 1e3,
        jump_step=config.outcomes.jump_step_mm / 1e3,
        large_jump=config.outcomes.large_jump_mm / 1e3,
    )
    params = replace(params, monitor=observer)
    if params.detectors is not None:
        levels = tuple(levels for _, _, levels in config.detectors)
        params = replace(params, detectors=replace(params.detectors, levels=levels))
    if params.reaction is not None and config.reaction is not None:
        asked = config.reaction.model_dump(exclude={"action", "correct_mm_s"})
        action = np.int32(ACTIONS.index(config.reaction.action))
        speed = config.reaction.correct_mm_s / 1e3
        params = replace(params, reaction=replace(params.reaction, action=action, correct_speed=speed, **asked))
    for joint, (low, high) in config.limits.si().items():
        for side, value in (("lower", low), ("upper", high)):
            stored = float(np.float32(value))  # the software holds its limits as float32
            params = paths.assign(params, setup, f"control.cartesian.{side}.{joint}", stored)
            params = paths.assign(params, setup, f"nominal.target.{side}.{joint}", value)
    return params


def _filled(varied: dict[str, np.ndarray], params: Any, setup: Setup) -> dict[str, np.ndarray]:
    """Varied values in the parameter's own type, the robot's own where a group leaves the parameter alone.

    A path of several numbers which a group leaves alone, and which are not all alike, becomes one path a number.
    """
    filled = {}
    for path, values in varied.items():
        alone, own = np.isnan(values), paths.named(params, setup, path)
        alike = len({float(value) for value in own.values()}) == 1
        for place, value in {path: next(iter(own.values()))}.items() if alike or not alone.any() else own.items():
            dtype = np.asarray(value).dtype
            dtype = np.dtype(setup.precision.real) if dtype.kind == "f" else np.dtype(np.int32)
            filled[place] = np.where(alone, np.asarray(value, np.float64), values).astype(dtype)
    return filled


def _twins(varied: dict[str, np.ndarray], runs: int) -> np.ndarray:
    """Runs whose varied parameters agree share a twin."""
    twin = np.zeros(runs, np.int64)
    for values in varied.values():
        value, different = pd.factorize(values)
        if len(different) > 1:
            twin, _ = pd.factorize(twin * len(different) + value)
    return twin.astype(np.int32)

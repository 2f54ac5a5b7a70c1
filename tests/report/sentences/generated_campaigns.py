"""Campaigns as no simulation gives them: any limit, cues, arms, detectors, reactions, and golden
runs that stray.

The tables hold to what every engine guarantees and to nothing else: before its first effect a fault
changes nothing, a time is -1 or within the run, what told a person has a time. Hazard and verdict
follow row by row.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import synthetic_results as synthetic
from hypothesis import strategies as st

from ravenjax.store import schema
from ravenjax.store.manifest import CueRecord, DetectorRecord, Manifest

BLOCKS = (
    ("usb_out", "overwrite"),
    ("encoder", "offset"),
    ("packet", "drop"),
    ("plc", "toggle"),
    ("friction_scale", "scale"),
    ("unheard_of", "noise"),
)
"""Site and effect; names without digits, so that every digit of the page is a number."""
CHECKS = {
    "overdrive_instant": "stopped",
    "soft_estop": "stopped",
    "ik_reject": "flagged",
    "master_timeout": "flagged",
    "overdrive_clip": "limited",
    "packet_skip": "limited",
}
CAUSES = {"overdrive_instant": "overdrive"}
"""Name of a check as the cause of a response, where it has another there."""
FATES = ("any", "any", "any", "all evade", "all told", "nothing happens", "all failed")
JUMPS = ("jump_code", "jump_tip", "jump_text")


class Plan(NamedTuple):
    """What a campaign is made of."""

    seed: int
    faults: int = 12
    free: int = 2  # runs without a fault
    groups: int = 3
    motions: int = 2  # different golden runs
    repeats: int = 0  # faults that are run a second time
    arms: tuple[str, ...] = ("gold",)
    limit_mm: float = 3.0
    thresholds: tuple[float, ...] = (3.0,)
    verdict_cue: int = 0
    detectors: int = 0
    actions: tuple[int, ...] = ()  # crossed; (): the operator cannot react
    usual: str = "release"  # what the operator does at a cue where a run does not say
    crossed_robot: bool = False  # a second crossed parameter
    stray: float = 0.3  # share of golden runs with cues and halts of their own
    fate: str = "any"
    jump: str = "jump_code"
    duration_ms: int = 2000


class Campaign(NamedTuple):
    """One campaign."""

    plan: Plan
    frame: pd.DataFrame
    manifest: Manifest


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """Any plan of a small campaign."""
    thresholds = draw(
        st.lists(st.sampled_from((0.7, 1.0, 2.345, 3.0, 4.5)), min_size=1, max_size=3, unique=True)
    )
    actions = draw(st.sampled_from(((), (), (0, 1), (0, 1, 3), (1,), (2,))))
    return Plan(
        seed=draw(st.integers(0, 10**6)),
        faults=draw(st.sampled_from((0, 1, 1, 2, 3, 8, 20, 40))),
        free=draw(st.sampled_from((0, 1, 4))),
        groups=draw(st.integers(1, 5)),
        motions=draw(st.integers(1, 5)),
        repeats=draw(st.sampled_from((0, 0, 1, 4))),
        arms=draw(st.sampled_from((("gold",), ("gold", "green")))),
        limit_mm=draw(st.sampled_from((0.5, 2.0, 3.0, 4.25, 12.0))),
        thresholds=tuple(thresholds),
        verdict_cue=draw(st.integers(0, len(thresholds) - 1)),
        detectors=draw(st.integers(0, 2)),
        actions=actions,
        usual=draw(st.sampled_from(("release", "slow", "none"))),
        crossed_robot=draw(st.booleans()) and len(actions) > 1,
        stray=draw(st.sampled_from((0.0, 0.3, 1.0))),
        fate=draw(st.sampled_from(FATES)),
        jump=draw(st.sampled_from(JUMPS)),
    )


def made(plan: Plan) -> Campaign:
    """The campaign of a plan, the same each time."""
    if not plan.faults + plan.free:
        plan = plan._replace(free=1)
    random = np.random.default_rng(plan.seed)
    shape = schema.Shape(
        arms=plan.arms,
        slots=1,
        cues=len(plan.thresholds),
        checks=tuple(CHECKS),
        parameters=("plant.friction_scale", *(("reaction.action",) if plan.actions else ())),
        reacts=bool(plan.actions),
        detectors=(3, 1)[: plan.detectors],
    )
    golden = [_golden(random, plan, shape, number) for number in range(plan.motions)]
    rows = _runs(random, plan, shape, golden)
    frame = pd.DataFrame(rows, columns=[column.name for column in schema.columns(shape)])
    text = [c.name for c in schema.columns(shape) if c.dtype in ("category", "string")]
    frame[text] = frame[text].astype(object)
    frame = synthetic.judged(frame, plan.verdict_cue)
    config = {
        "name": "generated",
        "reaction": {"action": plan.usual},
        "outcomes": {"jump_step_mm": 0.25, "large_jump_mm": 1.5},
    }
    manifest = synthetic.manifest(
        len(frame),
        campaign="generated",
        config=config,
        shape=shape,
        duration_ms=plan.duration_ms,
        cues=tuple(CueRecord(threshold_mm=t, kp_per_mm=0.0045, cap=0.05) for t in plan.thresholds),
        detectors=DETECTORS[: plan.detectors],
        verdict_cue=plan.verdict_cue,
        verdict_jump=plan.jump,
        limit_mm=plan.limit_mm,
    )
    return Campaign(plan, frame, manifest)


DETECTORS = (
    DetectorRecord("residual", "steps", "all", 1, (0.5, 1.0, 2.0)),
    DetectorRecord("envelope", "tip_error", "all", 3, (1.5,)),
)


def _golden(
    random: np.random.Generator, plan: Plan, shape: schema.Shape, number: int
) -> dict[str, Any]:
    """Outcomes of one golden run, by the names that they have beside a run."""
    strays = random.random() < plan.stray
    found: dict[str, Any] = {
        "golden_tip_path_mm": 30.0 + number,
        "golden_pedal_down_ms": int(random.integers(1000, plan.duration_ms)),
        "golden_halted_ms": int(random.choice([0, 5, 300])) if strays else 0,
        "golden_peak_live_deviation_mm": float(random.choice([0.4, 6.0])) if strays else 0.4,
        "golden_tissue_depth_mm": 0.0,
    }
    for k in range(shape.cues):
        came = strays and random.random() < 0.6
        found[f"golden_cue{k}_first_ms"] = int(random.integers(0, plan.duration_ms)) if came else -1
    for d in range(plan.detectors):
        found[f"golden_detector{d}_score"] = (
            float(random.choice([0.2, 0.6, 1.7])) if strays else 0.2
        )
    return found


def _runs(
    random: np.random.Generator, plan: Plan, shape: schema.Shape, golden: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    groups = [*("alpha", "beta", "gamma", "delta", "epsilon")[: plan.groups]]
    faults = [
        {
            "group": str(random.choice(groups)),
            "operator": str(random.choice(["suturing", "circle"])),
            "fault0_site": site,
            "fault0_effect": effect,
            "fault0_arm": str(random.choice(plan.arms)),
            "fault0_channel": "shoulder",
            "fault0_trigger": "time",
            "fault0_value": float(number),
            "fault0_start_ms": int(random.integers(100, 1500)),
            "fault0_duration_ms": int(random.choice([-1, 8, 64])),
            "param:plant.friction_scale": float(random.uniform(0.8, 1.2)),
        }
        for number, (site, effect) in enumerate(
            BLOCKS[int(b)] for b in random.integers(0, len(BLOCKS), plan.faults)
        )
    ]
    free = [
        {
            "group": "without fault",
            "operator": "circle",
            "fault0_value": np.nan,
            "param:plant.friction_scale": 0.9 + 0.01 * number,
        }
        for number in range(plan.free)
    ]
    again = [
        dict(faults[i]) | {"seed": 8}
        for i in random.integers(0, max(1, plan.faults), plan.repeats)
        if faults
    ]
    rows: list[dict[str, Any]] = []
    for given in [*faults, *free, *again]:
        own, pair = golden[int(random.integers(len(golden)))], len(rows)
        for friction in (
            (0.7, 1.4) if plan.crossed_robot else (given["param:plant.friction_scale"],)
        ):
            for action in plan.actions or (0,):
                row = _nothing(shape) | given | own | {"index": len(rows), "pair": pair}
                row["run_id"] = f"{len(rows):016x}"
                row["param:plant.friction_scale"] = friction
                if plan.actions:
                    unsaid = action and action == ["none", "release", "slow", "correct"].index(
                        plan.usual
                    )
                    row["param:reaction.action"] = (
                        np.nan if unsaid and random.random() < 0.5 else float(action)
                    )
                rows.append(row | _outcome(random, plan, row, action))
    return rows


def _nothing(shape: schema.Shape) -> dict[str, Any]:
    """A row in which nothing happened."""
    row: dict[str, Any] = {}
    for column in schema.columns(shape):
        if column.dtype in ("category", "string"):
            row[column.name] = ""
        elif column.dtype == "bool":
            row[column.name] = False
        else:
            row[column.name] = -1 if column.name.endswith("first_ms") else 0
    return row | {"seed": 7, "response": "silent", "response_ms": -1, "told_ms": -1}


def _outcome(
    random: np.random.Generator, plan: Plan, row: dict[str, Any], action: int
) -> dict[str, Any]:
    """What became of one run."""
    end = plan.duration_ms
    faulty = row["fault0_site"] != ""
    golden_cues = [row[f"golden_cue{k}_first_ms"] for k in range(len(plan.thresholds))]
    active = (
        faulty
        and plan.fate != "nothing happens"
        and (plan.fate == "all evade" or random.random() < 0.9)
    )
    onset = int(random.integers(100, 1600)) if active else -1
    found: dict[str, Any] = {
        "activated": active,
        "diverged": active,
        "first_active_ms": onset,
        "halted_ms": row["golden_halted_ms"],
        "pedal_down_ms": int(random.integers(500, end)),
        "failed": "nan" if random.random() < 0.07 or plan.fate == "all failed" else "",
    } | {f"cue{k}_first_ms": golden for k, golden in enumerate(golden_cues)}
    if plan.fate == "all evade":
        found["failed"] = ""
    for check in CHECKS:
        found[f"check_{check}_margin"] = float(
            random.choice([np.inf, np.nan, *random.normal(0, 900, 8).round(3)])
        )
        if random.random() < 0.1:  # as in its golden run
            found |= {f"check_{check}_first_ms": 50, f"check_{check}_count": 2}
    for d, detector in enumerate(DETECTORS[: plan.detectors]):
        score = (
            float(random.choice([0.1, 0.7, 1.2, 2.5]))
            if active
            else row[f"golden_detector{d}_score"]
        )
        found[f"detector{d}_score"] = score
        for k, threshold in enumerate(detector.thresholds):
            found[f"detector{d}_threshold{k}_first_ms"] = (
                int(random.integers(max(onset, 0), end)) if score > threshold else -1
            )
    if active:
        found |= _effects(random, plan, found, golden_cues)
    if plan.actions and action:
        delay = 150
        for name in ("", "golden_"):
            cue = found["cue0_first_ms"] if not name else golden_cues[0]
            found[f"{name}reaction_ms"] = cue + delay if 0 <= cue < end - delay else -1
    elif plan.actions:
        found |= {"reaction_ms": -1, "golden_reaction_ms": -1}
    return found


def _effects(
    random: np.random.Generator, plan: Plan, run: dict[str, Any], golden_cues: list[int]
) -> dict[str, Any]:
    """What the fault changed, from its first effect on."""
    onset, end = run["first_active_ms"], plan.duration_ms
    halted_ms = run["halted_ms"]

    def later(share: float, *like: int) -> int:
        """A time after the first effect, now and then one of others; -1 with the other share."""
        if random.random() >= share:
            return -1
        same = [ms for ms in like if ms >= onset]
        return (
            int(random.choice(same))
            if same and random.random() < 0.25
            else int(random.integers(onset, end))
        )

    found: dict[str, Any] = {}
    motion = later(1.0 if plan.fate == "all evade" else 0.45)
    found["unintended_first_ms"] = motion
    found["loss_first_ms"] = later(0.2)
    found["false_report_first_ms"] = later(0.25)
    found["halted_ms"] = halted_ms + int(random.choice([0, 0, 150, 200, 201, 900]))
    found["unintended_mm"] = round(
        float(random.uniform(1.01, 9) if motion >= 0 else 0.6) * plan.limit_mm, 2
    )
    found["unintended_off_mm"] = round(float(random.uniform(0, 8)), 2)
    found["tissue_depth_mm"] = round(float(random.uniform(0, 4)), 2)
    words = ["silent", "limited", "flagged", "stopped"]
    shares = {"all evade": [0.5, 0.5, 0, 0], "all told": [0, 0, 0.5, 0.5]}.get(
        plan.fate, [0.35, 0.25, 0.2, 0.2]
    )
    response = str(random.choice(words, p=shares))
    response_ms = later(1.0, motion) if response != "silent" else -1
    told_ms = {"flagged": response_ms, "stopped": int(random.choice([onset, response_ms]))}.get(
        response, -1
    )
    found |= {"response": response, "response_ms": response_ms, "told_ms": told_ms}
    if response != "silent":
        check = str(random.choice([name for name, does in CHECKS.items() if does == response]))
        found |= {f"check_{check}_first_ms": response_ms, f"check_{check}_count": 3}
        found["response_cause"] = CAUSES.get(check, check)
    for k, golden in enumerate(golden_cues):
        if not 0 <= golden < onset:  # before its first effect a fault changes nothing
            found[f"cue{k}_first_ms"] = later(0.6, motion, told_ms, golden, response_ms)
        found[f"cue{k}_peak_force"] = round(float(random.uniform(0.001, 0.05)), 4)
        found |= {
            f"cue{k}_ms": int(random.integers(1, 900)),
            f"cue{k}_count": int(random.integers(1, 5)),
        }
    if random.random() < 0.08:  # as no engine of ours gives it
        found |= {"cue0_first_ms": onset - 1}
    for name in JUMPS:
        found[name] = bool(random.random() < 0.3)
    return found

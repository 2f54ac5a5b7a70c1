"""Which joints make a jump, and whether the published detector, which watches the first three,
could tell it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ravenjax.numbers.lazy import jax
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.geometry import kinematics
from studies.dsn16.cells import DURATIONS
from studies.dsn16.detection import CHOSEN, Watched
from studies.dsn16.runs import VariantRuns
from studies.dsn16.statements import holds
from studies.framework.study import Line, Table

POSITIONING = 3
"""Joints that the detector watches, from the first on."""

MOVERS = tuple(joint.replace("_", " ") for joint in JOINTS[:5])
"""Joints that move the reported tip: the jaws turn about it."""

KINDS = (
    "joints 1-3 alone are a jump",
    "tool joints alone are a jump",
    "both alone are",
    "neither alone is",
)


class JumpJoints(NamedTuple):
    """What joints do in the two long steps of each run's first jump; the joints of a run without
    one are NaN.
    """

    shares: (
        np.ndarray
    )  # [runs, 5] of the steps' length, that each joint makes when it alone moves; signed
    positioning: (
        np.ndarray
    )  # bool [runs], with tool joints held both steps are still over the limit
    tool: np.ndarray  # bool [runs], with joints 1-3 held they are

    @property
    def kinds(self) -> tuple[np.ndarray, ...]:
        """Of KINDS: bool [runs] each; runs without a jump are in none."""
        jumped, first, last = np.isfinite(self.shares[:, 0]), self.positioning, self.tool
        return (
            jumped & first & ~last,
            jumped & last & ~first,
            jumped & first & last,
            jumped & ~first & ~last,
        )


def attribute(joints: np.ndarray, limit_mm: float) -> JumpJoints:
    """joints: [runs, 3, 7] (rad, m) of the gold arm, reported in the three packets of a jump;
    limit of a step.
    """
    before, after = joints[:, :-1], joints[:, 1:]  # [runs, 2 steps, 7]
    start = _tip(before)
    step = _tip(after) - start
    alone = np.stack(
        [_tip(_moved(before, after, slice(j, j + 1))) - start for j in range(len(MOVERS))], axis=2
    )
    along = (alone * step[:, :, None]).sum(axis=-1) / (step**2).sum(axis=-1)[:, :, None]

    def jumps(part: slice) -> np.ndarray:
        lengths = np.linalg.norm(_tip(_moved(before, after, part)) - start, axis=-1)
        return (lengths * 1e3 > limit_mm).all(axis=1)

    return JumpJoints(
        along.mean(axis=1), jumps(slice(0, POSITIONING)), jumps(slice(POSITIONING, None))
    )


def _moved(before: np.ndarray, after: np.ndarray, part: slice) -> np.ndarray:
    result = before.copy()
    result[..., part] = after[..., part]
    return result


def _tip(joints: np.ndarray) -> np.ndarray:
    """[.., 3] m of joints [.., 7]."""
    with jax.enable_x64(True):
        position = kinematics.forward("gold", Vec(np.moveaxis(joints, -1, 0))).position
    return np.stack([np.asarray(x) for x in position], axis=-1)


class Visibility(NamedTuple):
    """Which alarms of the detector come, inside the published window, with the CHOSEN
    thresholds.
    """

    fused: np.ndarray  # bool [runs]: all three variables over their thresholds in one row
    one: np.ndarray  # bool [runs]: at least one of them at some row

    @classmethod
    def of(cls, watched: Watched) -> Visibility:
        """Of the runs that were watched."""
        inside = np.array([alarm.inside for alarm in watched.alarms[CHOSEN]], bool).reshape(-1, 4)
        return cls(inside[:, 3], np.any(inside[:, :3], axis=1))


class JumpCase(NamedTuple):
    """The runs of a variant, what makes their jumps, and what could be told of them."""

    runs: VariantRuns
    joints: JumpJoints
    visible: Visibility


def case(runs: VariantRuns, watched: Watched, limit_mm: float) -> JumpCase:
    """Of one variant; limit_mm: of a step that counts."""
    return JumpCase(runs, attribute(watched.joints, limit_mm), Visibility.of(watched))


def by_kind(cases: Mapping[str, JumpCase]) -> Table:
    """First jumps by the joints that make them, and what the detector and the robot tell of
    them; name -> case.
    """
    rows = []
    for name, one in cases.items():
        kinds = dict(zip(KINDS, one.joints.kinds, strict=True)) | {
            "all": np.isfinite(one.joints.shares[:, 0])
        }
        for kind, mask in kinds.items():
            rows.append((name, kind, int(mask.sum()), *_told(one, mask)))
    heads = (
        "variant",
        "first jumps of which",
        "runs",
        "at 1 packet",
        "joints 1-3, median % of the steps",
    )
    heads += ("all three variables over, %", "none of the three over, %", "E-stop, %")
    note = (
        "A run's first jump is two long steps of the reported tip; each is taken again with joints"
        " 1-3 alone moving, and with the tool joints alone. Variables are those of the published"
        " detector: steps of motor position, motor velocity and joint position of joints 1-3"
        f" inside t1 .. t1 + d + 1, thresholds at {CHOSEN}. The detector raises an alarm where all"
        " three are over; a jump with none of them over it cannot see."
    )
    return Table("Which joints make the jumps, and who could tell", heads, tuple(rows), note)


def _told(one: JumpCase, mask: np.ndarray) -> tuple[str | int | float, ...]:
    if not mask.any():
        return (0, "", "", "", "")
    part = float(np.median(one.joints.shares[mask][:, :POSITIONING].sum(axis=1)))
    alarms = (one.visible.fused, ~one.visible.one, one.runs.hits["stop"])
    percent = (round(100.0 * float(flags[mask].mean()), 1) for flags in alarms)
    return (int((mask & (one.runs.duration == 1)).sum()), round(100.0 * part, 1), *percent)


def by_joint(one: JumpCase) -> Table:
    """Mean share of the jump's steps of each joint, by the fault's duration."""
    jumped = np.isfinite(one.joints.shares[:, 0])
    groups = [(str(d), jumped & (one.runs.duration == d)) for d in DURATIONS] + [("all", jumped)]
    rows = []
    for label, mask in groups:
        means = one.joints.shares[mask].mean(axis=0) if mask.any() else None
        shares = (
            ("",) * len(MOVERS)
            if means is None
            else tuple(round(100.0 * float(x), 1) for x in means)
        )
        rows.append((label, int(mask.sum()), *shares))
    note = (
        "Mean over first jumps; a joint against the step counts negative, and joints that cancel"
        " pass 100 %."
    )
    heads = ("duration, packets", "jumps", *(f"{joint}, %" for joint in MOVERS))
    return Table(f"Whose motion the jumps are; {one.runs.name}", heads, tuple(rows), note)


def visible(one: JumpCase) -> Line:
    """Whether the published detector can see most of the predicted jumps: what it cannot see, it
    was not scored on.
    """
    jumped = np.isfinite(one.joints.shares[:, 0])
    runs = int(jumped.sum())
    fused, none = int((jumped & one.visible.fused).sum()), int((jumped & ~one.visible.one).sum())
    return holds(
        "the predicted jumps are ones that the published detector can see",
        None,
        2 * fused > runs,
        f"counted as: it tells more than half of the {runs} runs that jump; it tells {fused}, and"
        f" in {none} none of its variables passes its threshold",
    )


def note(cases: Iterable[JumpCase]) -> str:
    """Who makes the jumps, in words."""
    return " ".join(_sentence(one) for one in cases)


def _sentence(one: JumpCase) -> str:
    jumped = np.isfinite(one.joints.shares[:, 0])
    runs = int(jumped.sum())
    if not runs:
        return f"{one.runs.name}: no run jumps."
    first, tool, both, neither = (int(kind.sum()) for kind in one.joints.kinds)
    return (
        f"{one.runs.name}: {runs} of {len(jumped)} runs jump, by joints 1-3 alone {first}, by the"
        f" tool joints alone {tool}, by either {both}, by both together only {neither}."
    )

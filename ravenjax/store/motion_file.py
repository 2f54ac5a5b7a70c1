"""Recorded operator motions: a file becomes a motion that is evenly timed, smooth and inside what the arm can reach.

`motion_table` says which files and columns.

Time stamps of recordings come in bursts, so samples are spread evenly over the recording; only a gap or a step
backwards is an error. The tip is low-passed without phase. Without an orientation in the file the home orientation is
kept. A stretch in which some arm would leave its soft limits is not used.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robot.motion import NOMINAL_SCALE, TICK_S, Motion
from ravenjax.stages.motions import MOTION_S, PEDAL_DOWN_S
from ravenjax.store import motion_table
from ravenjax.store.motion_table import ArmTrack, Track
from ravenjax.types import ArmName, Vec

LONGEST_GAP_S = 0.1
"""s between two time stamps. The public recording comes in bursts some 40 ms apart."""

CUTOFF_HZ = 5.0
"""Voluntary hand motion lies below; tremor and the steps of a recorder above."""

RUN_UP_S = 0.5
"""s from rest until the motion is replayed at full speed."""

MARGIN_RAD, MARGIN_M = math.radians(1.0), 2e-3
"""Distance kept from the soft limits: the robot lags behind the operator."""

LARGEST_STEP = 0.1
"""rad or m within a millisecond; more is a change of branch, not a motion."""

BLOCK_ROWS = 4096


@dataclasses.dataclass(frozen=True)
class _Even:
    """A recording at 1 kHz."""

    position: np.ndarray  # [T, A, 3] m
    quat: np.ndarray  # [T, A, 4]
    opening_mrad: np.ndarray  # [T, A]
    surgeon_mode: np.ndarray | None  # [T]


def read(
    path: Path,
    arms: tuple[ArmName, ...] = ("gold",),
    window_s: tuple[float, float] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
    slow_down: float = 1.0,
) -> Motion:
    """The motion in a recording of `arms`.

    window_s: [begin, end] in the recording, s; without it the longest stretch that all arms can reach is taken.
    slow_down: how much slower than recorded it is replayed. The tip moves as recorded at scale `NOMINAL_SCALE`.
    Raises UserError for a file that cannot be used and for a window that cannot be reached.
    """
    track = motion_table.read(path, arms)
    even = _evenly(track, arms, cutoff_hz)
    jpos, reachable = _joints(arms, even)
    begin, end = _window(path, reachable, window_s)
    clock, pedal = _clock(end - begin, slow_down)
    rows = begin + clock
    if even.surgeon_mode is not None:
        pedal = pedal * even.surgeon_mode[np.rint(rows).astype(int)]
    hand, quat, grasp = [], [], []
    for i, arm in enumerate(arms):
        position, turned = _itp(arm, _at(even.position[:, i], rows), _at(even.quat[:, i], rows))
        hand.append(position)
        quat.append(turned)
        opening = _at(even.opening_mrad[:, i], rows)
        grasp.append(opening[0] - opening)  # the console's grasp closes
    return Motion(
        name=path.stem,
        arms=arms,
        position_um=np.stack(hand, axis=1),
        quat=np.stack(quat, axis=1),
        grasp_mrad=np.stack(grasp, axis=1),
        surgeon_mode=pedal,
        start_jpos=tuple(tuple(jpos[i][begin].tolist()) for i in range(len(arms))),
    )


# --- even time --------------------------------------------------------------------------------------------------------


def _evenly(track: Track, arms: tuple[ArmName, ...], cutoff_hz: float) -> _Even:
    samples = len(track)
    duration = (samples - 1) * TICK_S if track.time_s is None else _duration(track)
    rows = max(2, round(duration / TICK_S) + 1)
    at = np.linspace(0.0, samples - 1, rows)

    def smooth(values: np.ndarray) -> np.ndarray:
        return _low_pass(_at(values, at), cutoff_hz)

    position, quat, opening = [], [], []
    for arm in arms:
        arm_track = track.arms[arm]
        position.append(smooth(arm_track.position))
        quat.append(_turns(arm, arm_track, rows, smooth))
        jaws = arm_track.opening_mrad
        opening.append(np.full(rows, _home_opening_mrad()) if jaws is None else smooth(jaws))
    pedal = track.surgeon_mode
    if pedal is not None:
        pedal = (pedal[np.minimum(np.rint(at).astype(int), samples - 1)] > 0.5).astype(float)
    return _Even(np.stack(position, 1), np.stack(quat, 1), np.stack(opening, 1), pedal)


def _duration(track: Track) -> float:
    """Seconds that the recording lasts; UserError for gaps and for time that runs backwards."""
    time = track.time_s
    assert time is not None
    steps = np.diff(time)
    if (back := np.flatnonzero(steps < 0.0)).size:
        row = int(back[0]) + 1
        raise UserError(f"{track.path}: row {row}: time goes back by {-steps[back[0]]:.6g} s; expected it never to")
    if (gaps := np.flatnonzero(steps > LONGEST_GAP_S)).size:
        row, worst = int(gaps[0]), int(gaps[np.argmax(steps[gaps])])
        raise UserError(
            f"{track.path}: gap of {steps[row]:.3f} s after row {row} (t = {time[row]:.3f} s); expected at most "
            f"{LONGEST_GAP_S} s between samples. {gaps.size} such gaps, the longest {steps[worst]:.3f} s after row "
            f"{worst}. Cut the file at its gaps, or fill them"
        )
    if time[-1] <= 0.0:
        raise UserError(
            f"{track.path}: all {len(time)} rows have one time stamp; drop the column if rows are milliseconds"
        )
    return float(time[-1])


def _at(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """`values` [T] or [T, k] at fractional rows, linearly."""
    low = np.clip(np.floor(rows).astype(int), 0, len(values) - 2)
    part = (rows - low).reshape(-1, *[1] * (values.ndim - 1))
    return values[low] * (1.0 - part) + values[low + 1] * part


def _low_pass(values: np.ndarray, cutoff_hz: float) -> np.ndarray:
    from scipy.signal import butter, sosfiltfilt  # slow to import

    sections = butter(2, cutoff_hz, fs=1.0 / TICK_S, output="sos")
    padding = min(len(values) - 1, round(3.0 / (cutoff_hz * TICK_S)))
    return sosfiltfilt(sections, values, axis=0, padlen=padding)


def _turns(arm: ArmName, track: ArmTrack, rows: int, smooth: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    if track.quat is None:
        return np.repeat(_home_quat(arm)[None], rows, axis=0)
    signs = np.cumprod(np.where(np.sum(track.quat[1:] * track.quat[:-1], axis=1) < 0.0, -1.0, 1.0))
    quat = smooth(track.quat * np.concatenate([[1.0], signs])[:, None])
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)


def _clock(rows: int, slow_down: float) -> tuple[np.ndarray, np.ndarray]:
    """Row of the window (fractional) and pedal in each tick: a rest, a run-up to full speed, then on to the end."""
    rest, run_up = round(MOTION_S / TICK_S), round(RUN_UP_S / TICK_S)
    fraction = np.arange(1, run_up + 1) / run_up
    start = run_up / slow_down * fraction**4 * (2.5 - 3.0 * fraction + fraction**2)
    left = max(0, math.floor((rows - 1 - start[-1]) * slow_down))
    clock = np.concatenate([np.zeros(rest), start, start[-1] + np.arange(1, left + 1) / slow_down])
    pedal = (np.arange(len(clock)) >= round(PEDAL_DOWN_S / TICK_S)).astype(float)
    return np.minimum(clock, rows - 1), pedal


# --- what the arm can reach -------------------------------------------------------------------------------------------


def _joints(arms: tuple[ArmName, ...], even: _Even) -> tuple[list[np.ndarray], np.ndarray]:
    """Joints [T, 7] of each arm, and whether [T] every arm is inside its soft limits."""
    from ravenjax.robot import limits

    soft = limits.soft_limits("r_grasper")
    margin = np.array([MARGIN_RAD, MARGIN_RAD, MARGIN_M, MARGIN_RAD, MARGIN_RAD])
    lower, upper = np.array(soft.lower[:5], float) + margin, np.array(soft.upper[:5], float) - margin
    joints, reachable = [], np.ones(len(even.position), bool)
    for i, arm in enumerate(arms):
        found, valid = _candidates(arm, even.position[:, i], even.quat[:, i], even.opening_mrad[:, i] * 1e-3)
        turn = 2.0 * math.pi
        found[..., 3] -= turn * np.round(found[..., 3] / turn)
        inside = valid & ((found[..., :5] >= lower) & (found[..., :5] <= upper)).all(axis=-1)
        best = np.argmax(inside, axis=1)
        joints.append(np.take_along_axis(found, best[:, None, None], axis=1)[:, 0])
        steps = np.abs(np.diff(joints[-1][:, :6], axis=0, prepend=joints[-1][:1, :6])).max(axis=1)
        reachable &= inside.any(axis=1) & (steps < LARGEST_STEP)
    return joints, reachable


def _candidates(arm: ArmName, *poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All solutions [T, 8, 7] of positions, quaternions and jaw openings (rad), and their validity [T, 8]."""
    import jax

    rows = len(poses[0])
    blocks = []
    with jax.enable_x64(True):
        for begin in range(0, rows, BLOCK_ROWS):
            index = np.minimum(np.arange(begin, begin + BLOCK_ROWS), rows - 1)
            blocks.append([np.array(x) for x in _solver(arm)(*(pose[index] for pose in poses))])
    joints, valid = (np.concatenate(part)[:rows] for part in zip(*blocks, strict=True))
    return joints, valid


@functools.cache
def _solver(arm: ArmName) -> Callable[..., Any]:
    """The inverse kinematics of one arm for BLOCK_ROWS poses, compiled once."""
    import jax
    import jax.numpy as jnp

    from ravenjax.robot import kinematics
    from ravenjax.robot.joints import joint_from_theta
    from ravenjax.robot.mapping import matrix_from_quat

    def solve(position: Any, quat: Any, opening: Any) -> tuple[Any, Any]:
        pose = kinematics.Pose(Vec(position), matrix_from_quat(Vec(quat)))
        found = kinematics.inverse_candidates(arm, pose)
        joints = [jnp.stack(list(joint_from_theta(arm, theta, opening))) for theta, _ in found]
        return jnp.stack(joints), jnp.stack([jnp.asarray(valid) for _, valid in found])

    return jax.jit(jax.vmap(solve))


def _window(path: Path, reachable: np.ndarray, window_s: tuple[float, float] | None) -> tuple[int, int]:
    """First row and row after the last of the motion."""
    stretches = _stretches(reachable)
    longest = sorted(stretches, key=lambda s: (s[0] - s[1], s[0]))[:4]
    listed = ", ".join(f"[{a * TICK_S:.2f}, {b * TICK_S:.2f}]" for a, b in longest) or "none"
    if window_s is None:
        if not longest or longest[0][1] - longest[0][0] < 2:
            raise UserError(f"{path}: no row lies inside the soft joint limits of every arm; nothing can be replayed")
        return longest[0]
    begin, end = (round(s / TICK_S) for s in window_s)
    if not 0 <= begin < end <= len(reachable):
        whole = len(reachable) * TICK_S
        raise UserError(f"{path}: window_s {list(window_s)} is outside the recording, expected in 0 .. {whole:.3f} s")
    if not reachable[begin:end].all():
        bad = begin + int(np.argmin(reachable[begin:end]))
        raise UserError(
            f"{path}: window_s {list(window_s)}: at {bad * TICK_S:.3f} s an arm cannot reach the pose inside its soft "
            f"joint limits. Reachable stretches, longest first: {listed} s"
        )
    return begin, end


def _stretches(reachable: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], reachable, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


# --- into the hands' frame --------------------------------------------------------------------------------------------


def _itp(arm: ArmName, position: np.ndarray, quat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hand positions [T, 3] um and quaternions [T, 4] in the ITP frame, relative to the first row."""
    from scipy.spatial.transform import Rotation

    from ravenjax.robot.mapping import ITP_AXES

    axes = np.array(ITP_AXES[arm])  # x @ axes is the inverse of the mapping
    turns = Rotation.from_quat(quat)
    turn = (turns * turns[0].inv()).as_quat()
    turn *= np.where(turn[:, 3:] < 0.0, -1.0, 1.0)
    hand = (position - position[0]) @ axes / NOMINAL_SCALE * 1e6
    return hand, np.concatenate([turn[:, :3] @ axes, turn[:, 3:]], axis=1)


def _home_opening_mrad() -> float:
    from ravenjax.robot.limits import HOME_JPOS

    return (HOME_JPOS[5] + HOME_JPOS[6]) * 1e3


def _home_quat(arm: ArmName) -> np.ndarray:
    import jax

    from ravenjax.robot import kinematics, limits, mapping

    with jax.enable_x64(True):
        pose = kinematics.forward(arm, Vec(np.float64(q) for q in limits.HOME_JPOS))
        return np.array([float(c) for c in mapping.quat_from_matrix(pose.rotation)])

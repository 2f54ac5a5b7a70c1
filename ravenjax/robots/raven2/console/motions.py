"""Generates operator motions: smooth, surgical in speed and size, reproducible. NumPy only.

Each motion is a chain of segments. A segment begins and ends at rest and follows the minimum-jerk
time law, so position, orientation and grasp are twice continuously differentiable. The motion is
planned as tip motion at the scale `NOMINAL_SCALE`, from the arm's home pose. Its axes are those of
the instrument: a and b point sideways, c along the shaft into the tissue. At scales up to 0.2,
every pose lies inside the soft limits.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax import resources
from ravenjax.numbers.trigonometry import cos, sin
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.motion import NOMINAL_SCALE, Motion
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.vocabulary import TICK_S

PEDAL_DOWN_S = 0.2
"""Time at which the pedal goes down, s."""
MOTION_S = 0.5
"""Time at which the hands begin to move, s."""
PEAK_TIP_SPEED = 0.045
"""Peak speed of the tip, m/s at NOMINAL_SCALE. In surgery tips move at 5 to 60 mm/s."""
PEAK_TURN = math.radians(150.0)
"""Peak turning speed, rad/s."""
_SHAFT = np.array([-0.939120456543, -0.304404280732, 0.159344915150])
"""Direction from the remote centre to the gold tip in the home pose, frame 0 of the arm."""
_TIP, _TURN, _GRASP, _HAND = slice(0, 3), slice(3, 6), 6, slice(7, 10)
"""Parts of a pose [10]: tip offset from home a, b, c [m], rotation vector about a, b, c [rad],
grasp [mrad], and offset of the hand from the tip [m of the tip], which changes with the pedal up.
"""
_REST = np.zeros(10)


class Segment(NamedTuple):
    """One piece of a motion."""

    ticks: int
    poses: Callable[[np.ndarray], np.ndarray]  # fraction of the segment's time [n] -> poses [n, 10]
    pedal: float = 1.0  # 1: down, 0: up


Segments = Iterator[Segment]


def minimum_jerk(fraction: np.ndarray) -> np.ndarray:
    """Return the progress 0..1 of a rest-to-rest move after a `fraction` 0..1 of its time."""
    # Not `**3`, whose last bit depends on the host
    return fraction * fraction * fraction * (10.0 - 15.0 * fraction + 6.0 * fraction**2)


class _Path:
    """A chain of segments. The methods return the next segment and move `pose`, its end, along."""

    def __init__(self, rng: np.random.Generator):
        self.pose, self.rng = _REST.copy(), rng

    def _move_ticks(self, distance: float, turn: float, pace: float) -> int:
        # Returns the duration of a minimum-jerk move over `distance` (m) and `turn` (rad), ticks.
        # pace: peak speed as a share of PEAK_TIP_SPEED and PEAK_TURN.
        # The peak speed of a minimum-jerk move is 15/8 of its mean speed
        seconds = 1.875 * max(distance / PEAK_TIP_SPEED, turn / PEAK_TURN) / pace
        return max(math.ceil(seconds / TICK_S), 250)  # no move is shorter than 0.25 s

    def _move_to(self, pose: np.ndarray, ticks: int, pedal: float = 1.0) -> Segment:
        # Returns a straight move to `pose`, which becomes the end of the path.
        begin, self.pose = self.pose, pose
        return Segment(ticks, lambda s: begin + minimum_jerk(s)[:, None] * (pose - begin), pedal)

    def move(
        self,
        tip: Sequence[float] | np.ndarray | None = None,
        turn: Sequence[float] | np.ndarray | None = None,
        grasp: float | None = None,
        pace: float = 1.0,
    ) -> Segment:
        """Return a straight move to a new tip offset [m], rotation vector [rad] and grasp [mrad].
        None leaves a value unchanged.
        """
        end = self.pose.copy()
        for part, value in ((_TIP, tip), (_TURN, turn), (_GRASP, grasp)):
            if value is not None:
                end[part] = value
        # With `axis`, `norm` has the same bits on every CPU
        distance = float(np.linalg.norm((end - self.pose)[_TIP], axis=0))
        angle = float(np.linalg.norm((end - self.pose)[_TURN], axis=0))
        return self._move_to(end, self._move_ticks(distance, angle, pace))

    def arc(self, radius: float, angle: float, roll: float) -> Segment:
        """Return the path of a needle: an arc in the a-c plane, while the shaft rolls.
        radius: m. angle: of the arc, rad. roll: of the shaft, rad.
        """
        begin = self.pose

        def poses(fraction: np.ndarray):
            # Returns the poses [n, 10] at fractions [n] of the segment's time.
            progress = minimum_jerk(fraction)
            out = np.repeat(begin[None], len(progress), axis=0)
            out[:, 0] += radius * (1.0 - cos(progress * angle))  # tip along a
            out[:, 2] += radius * sin(progress * angle)  # tip along c, into the tissue
            out[:, 5] += progress * roll  # rotation about c, the shaft
            return out

        self.pose = poses(np.ones(1))[0]
        return Segment(self._move_ticks(radius * angle, abs(roll), pace=1.0), poses)

    def dwell(self, seconds: float) -> Segment:
        """Return a rest at the present pose."""
        return self._move_to(self.pose, max(1, round(seconds / TICK_S)))

    def release(self, seconds: float) -> Segment:
        """Return a segment with the pedal up: the hand returns to its start while the tip stays."""
        end = self.pose.copy()
        end[_HAND] = -end[_TIP]
        return self._move_to(end, round(seconds / TICK_S), pedal=0.0)

    def draw_target(self) -> tuple[np.ndarray, np.ndarray]:
        """Return a random tip offset [m] and rotation vector [rad] near the home pose."""
        direction = self.rng.normal(size=3)
        offset = direction / np.linalg.norm(direction, axis=0) * self.rng.uniform(0.5, 1.0)
        # Half axes of an ellipsoid about the home tip, m
        tip = offset * np.array([0.012, 0.012, 0.008])
        return tip, self.rng.uniform(-1.0, 1.0, 3) * np.radians([12.0, 12.0, 40.0])

    # --- the motions of motions.toml: endless chains of segments ---

    def still(self) -> Segments:
        while True:
            yield self.dwell(1.0)

    def reach(self) -> Segments:
        while True:
            yield self.move(*self.draw_target(), pace=self.rng.uniform(0.5, 1.0))
            yield self.dwell(self.rng.uniform(0.05, 0.3))

    def clutched(self) -> Segments:
        # Moves, then lifts the pedal and moves the hand back, again and again.
        while True:
            reach = self.move(*self.draw_target())
            yield reach
            # Reach and dwell take 1.4 s together, because arms that share a pedal need equal cycles
            yield self.dwell(1.4 - reach.ticks * TICK_S)
            yield self.release(0.6)
            yield self.dwell(0.4)  # the robot needs some cycles to enter pedal-down

    def circle(self) -> Segments:
        # Moves the tip on a circle of 8 mm radius, once in 2 s.
        radius, round_s, run_up_s = 0.008, 2.0, 1.0
        start = self.rng.uniform(0.0, 2.0 * math.pi)
        speed = 2.0 * math.pi / round_s

        def poses(phase: np.ndarray):
            # Returns the poses [n, 10] at angles `phase` [n] from the start of the circle, rad.
            out = np.zeros((len(phase), len(_REST)))
            out[:, 0] = radius * (cos(start + phase) - cos(start))
            out[:, 1] = radius * (sin(start + phase) - sin(start))
            return out

        # In the run-up, the speed rises as `minimum_jerk`, whose integral is the polynomial. It is
        # 1/2 at the end, so the run-up covers half of `angle`, the angle at the full speed
        ticks, angle = round(run_up_s / TICK_S), speed * run_up_s
        yield Segment(ticks, lambda s: poses(angle * s**2 * s**2 * (2.5 - 3.0 * s + s**2)))
        while True:
            yield Segment(round(round_s / TICK_S), lambda s: poses(angle / 2.0 + 2.0 * math.pi * s))

    def palpate(self) -> Segments:
        # Presses the tissue at one place after the other, 4 mm apart along a. The row reverses at
        # 13 mm from home. Tips are (a, b, c), m; c grows into the tissue, and -2 mm is above it.
        side, direction = 0.0, 1.0
        while True:
            depth = self.rng.uniform(0.003, 0.005)
            tip = self.pose[:3]
            yield self.move((tip[0], tip[1], depth), pace=0.6)  # press
            yield self.dwell(self.rng.uniform(0.05, 0.15))
            yield self.move((tip[0], tip[1], -0.002), pace=0.8)
            if abs(side + 0.004 * direction) > 0.013:
                direction = -direction
            side += 0.004 * direction
            yield self.move((side, self.rng.uniform(-0.004, 0.004), -0.002), pace=0.8)

    def peg_transfer(self) -> Segments:
        # Moves an object from one peg to another peg, again and again. Tips are (a, b, c), m; c
        # grows toward the pegs' base. Grasps grow as jaws close.
        open_mrad, closed_mrad, lift = 0.0, 900.0, -0.010
        pegs = [(a, b) for a in (-0.010, 0.0, 0.010) for b in (-0.008, 0.008)]
        source = -1
        while True:
            free = [i for i in range(len(pegs)) if i != source]
            source, target = (int(i) for i in self.rng.permutation(free)[:2])
            turn = math.radians(self.rng.uniform(-35.0, 35.0))
            yield self.move((*pegs[source], lift), (0.0, 0.0, 0.0), open_mrad)
            yield self.move((*pegs[source], 0.002), pace=0.7)  # down to the object
            yield self.move(grasp=closed_mrad)
            yield self.move((*pegs[source], lift))
            yield self.move((*pegs[target], lift), (0.0, 0.0, turn))
            yield self.move((*pegs[target], 0.002), pace=0.7)  # down onto the other peg
            yield self.move(grasp=open_mrad)
            yield self.move((*pegs[target], lift))
            source = target

    def suture(self) -> Segments:
        # Sews: pierces, turns the needle through the tissue, pulls, moves on along the wound. Tips
        # are (a, b, c), m: the wound runs along b, and c grows into the tissue.
        open_mrad, closed_mrad = 300.0, 1100.0
        roll, radius = math.radians(100.0), 0.006
        row = -0.009
        while True:
            entry = self.rng.uniform(-0.010, -0.006)
            yield self.move((entry, row, -0.006), (0.0, 0.0, -roll / 2.0), closed_mrad)
            yield self.move((entry, row, 0.0), pace=0.7)  # pierce
            yield self.arc(radius, math.radians(150.0), roll)  # drive the needle through
            yield self.move(grasp=open_mrad)
            yield self.move((self.pose[0], row, -0.008))
            yield self.move((self.pose[0] + 0.003, row, 0.001), (0.0, 0.0, 0.0))  # to its other end
            yield self.move(grasp=closed_mrad)
            beside = self.pose[0] - 0.006, row + 0.006, -0.012
            yield self.move(beside, (math.radians(10.0), 0.0, roll / 3.0))  # pull
            row = -0.009 if row > 0.006 else row + self.rng.uniform(0.003, 0.005)


MOTIONS: dict[str, str] = resources.read_tables(__file__, "motions.toml")
"""Names and descriptions of the motions; sizes and speeds are the tip's at NOMINAL_SCALE."""


def generate_motion(
    name: str, duration_s: float, arms: tuple[ArmName, ...] = ("gold",), seed: int = 0
) -> Motion:
    """Return the named motion for `duration_s` seconds. Arms have different random numbers; the
    green arm's motion is mirrored. The arms share a pedal. Raises KeyError for an unknown name.
    """
    if name not in MOTIONS:
        raise KeyError(name)
    # 1e-9: a duration of whole ticks may be larger by a rounding error
    rows = max(1, math.ceil(duration_s / TICK_S - 1e-9))
    paths = [_Path(np.random.default_rng([seed, i])) for i in range(len(arms))]
    # The method of `_Path` with the name of the motion yields the segments
    chains = [getattr(path, name)() for path in paths]
    poses, pedals = zip(*(_sample_segments(chain, rows) for chain in chains), strict=True)
    position, quat = zip(*map(_hand_motion, arms, poses), strict=True)
    return Motion(
        name=name,
        arms=tuple(arms),
        position_um=np.stack(position, axis=1),
        quat=np.stack(quat, axis=1),
        grasp_mrad=np.stack(poses, axis=1)[..., _GRASP],
        surgeon_mode=pedals[0],
        start_jpos=(tuple(map(float, HOME_JPOS)),) * len(arms),
    )


def _sample_segments(segments: Segments, rows: int) -> tuple[np.ndarray, np.ndarray]:
    # Returns poses [rows, 10] and pedal [rows] along a chain of segments, one row per tick. The
    # segments begin after a rest of MOTION_S, with the pedal down from PEDAL_DOWN_S on.
    up_ticks, down_ticks = round(PEDAL_DOWN_S / TICK_S), round((MOTION_S - PEDAL_DOWN_S) / TICK_S)
    ticks = up_ticks + down_ticks
    poses = [np.repeat(_REST[None], ticks, axis=0)]
    pedals = [np.zeros(up_ticks), np.ones(down_ticks)]
    while ticks < rows:
        segment = next(segments)
        poses.append(segment.poses(np.arange(1, segment.ticks + 1) / segment.ticks))
        pedals.append(np.full(segment.ticks, segment.pedal))
        ticks += segment.ticks
    return np.concatenate(poses)[:rows], np.concatenate(pedals)[:rows]


def _hand_motion(arm: ArmName, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return hand positions [T, 3] um and quaternions [T, 4] in the arm's ITP frame."""
    axes = _instrument_axes()
    # [T, 3], m in frame 0. While the pedal is up, the hand moves alone; _HAND is this motion
    hand = _multiply(poses[:, _TIP] + poses[:, _HAND], axes)
    turn = _multiply(poses[:, _TURN], axes)
    if arm == "green":
        # gold mirrored at the x-z plane of frame 0; rotations mirror as pseudovectors
        hand, turn = hand * [1.0, -1.0, 1.0], turn * [-1.0, 1.0, -1.0]
    # The matrix turns columns from ITP to frame 0. A row times this matrix turns back, to ITP. The
    # hand moves 1 / NOMINAL_SCALE times as far as the tip
    from_itp = np.array(ITP_AXES[arm])
    return _multiply(hand, from_itp) / NOMINAL_SCALE * 1e6, _quaternions(_multiply(turn, from_itp))


def _multiply(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return rows [T, 3] times a matrix [3, 3], with the same bits on every CPU, unlike BLAS."""
    return sum(rows[:, k, None] * matrix[k] for k in range(3))  # type: ignore[return-value]


def _instrument_axes() -> np.ndarray:
    # Returns the axes a, b and c of the gold instrument in the home pose: rows [3, 3], frame 0.
    a = np.cross(_SHAFT, [0.0, 0.0, 1.0])
    a /= np.linalg.norm(a, axis=0)
    return np.stack([a, np.cross(_SHAFT, a), _SHAFT])


def _quaternions(turn: np.ndarray) -> np.ndarray:
    # Returns the quaternions [T, 4] of rotation vectors [T, 3], rad.
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    axis = np.divide(turn, angle, out=np.zeros_like(turn), where=angle > 0.0)
    return np.concatenate([axis * sin(angle / 2.0), cos(angle / 2.0)], axis=1)

"""Drives a robot in another process over ITP, and compares its reports with a nominal model.

The session's process computes the console's half of the tick: packets from the operator's motion,
the nominal model, and the cue from the robot's reports. If the reports stop, the session treats the
robot as stopped. The true tip and the golden run are unknown. The measured tip and the nominal
model replace them, and `false_report_mm` is NaN.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.campaign import compile_cache
from ravenjax.engines import trace_key
from ravenjax.engines.cpu.stepper import StepCode, Stepper
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import cast_to_real, per_arm
from ravenjax.numbers.vec import Scalar, Vec, cast, replace
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.loop import observers
from ravenjax.robots.raven2.loop.observers import RobotSignals
from ravenjax.stages import monitor
from ravenjax.train.protocol import Frame, Json
from ravenjax.train.robot import ARMS, E_STOP, FIELDS, ROBOT, kinematics
from ravenjax.train.robot_link import WORDS
from ravenjax.train.robot_link.joint_stream import JointReport, RobotLink
from ravenjax.train.session.simulation import SOURCE, Blueprint, hazard_distances, write_numbers

_CHECKS = frozenset(ROBOT.checks)
_MAX_TRIPS = 2**23
"""Limit of a check's count, so that the sum stays a whole number in single precision."""
_SOURCE = Path(__file__).read_bytes()  # Part of the key of compiled code in the cache


class DistantRobot:
    """A robot in another process, with the methods of `simulation.SimulatedRobot`."""

    next_tick = 0
    _sequence = 0

    def __init__(self, blueprint: Blueprint, remote: RobotLink):
        self.blueprint, self.remote = blueprint, remote
        self.arms = blueprint.setup.arms
        self._stepper = Stepper(_console_code(blueprint), ())
        self.motion = self._stepper.flat.reshape(len(self._stepper.tables), -1)
        self._frame = Frame(blueprint.layout)
        self.row = self._frame.row[: blueprint.layout.simulated]
        self._output = np.zeros(self._stepper.code.outputs, np.float32)
        resting = _resting_report(blueprint)
        self._resting_numbers = tree.tree_leaves(resting)
        self._reported: RobotSignals = tree.fill_tree(resting, self._stepper.step_inputs)
        places = blueprint.layout.places
        names = [f"{arm}/{name}" for arm in self.arms for name in WORDS["of_console"]]
        # Positions in the row of the half tick's first outputs. The packet's numbers follow them.
        self._computed_places = np.r_[*(places[name] for name in (*names, "halted_ms"))]
        self._outcomes: Json = {}
        self._assume_rest()

    def step(self) -> None:
        """Compute one tick: move the model, send the packet, read the newest report."""
        self._stepper.step(self.next_tick, self._output.ctypes.data)
        count = len(self._computed_places)
        self.row[self._computed_places] = self._output[:count]
        self._sequence += 1
        report = self.remote.exchange(self._datagram(self._output[count:].tolist()))
        if report is not None and not self.remote.stale:
            self._use_report(report)
        else:
            self._lose_reports()
        self._frame["tick"] = self.next_tick
        self.next_tick += 1

    def outcomes(self) -> Json:
        """Return the outcome columns that the robot's reports contain."""
        return dict(self._outcomes)

    def golden_outcomes(self) -> None:
        """Return None, because a distant robot has no golden run."""

    def reset(self) -> None:
        """Order the robot to restart, and restart the model."""
        self.remote.order({"order": "reset"})
        self._stepper.begin()
        self._assume_rest()
        self.next_tick, self._outcomes = 0, {}
        self._frame["trips"] = 0

    def stand_by(self) -> None:
        """Restart the motion table, so that it does not end. Robot and model do not move."""
        removed_ms = self.next_tick - 1
        # [columns, ticks]. The next packet has the motion since the newest tick, now the first.
        self.motion[:, 0] = self.motion[:, removed_ms]
        self.next_tick = 1
        for name in self._outcomes:
            # Times count from the table's start. A negative time is before this start.
            if name.endswith("_first_ms"):
                self._outcomes[name] -= removed_ms

    @property
    def reports_arrive(self) -> bool:
        return self.remote.report is not None and not self.remote.stale

    def arm(self, row: int) -> None:
        """Restart the monitor, and order the robot to arm the hazard of this fault-table row."""
        restart = monitor.restart_monitor
        self._stepper.change(lambda state: replace(state, monitor=restart(state.monitor)))
        self.remote.order({"order": "arm", "number": row})

    def disarm(self) -> None:
        self.remote.order({"order": "disarm"})

    def press_estop(self, row: int) -> None:
        self.remote.order({"order": "estop"})

    def _assume_rest(self):
        self._set_report(self._resting_numbers)
        # Whether the last report had a stop by this check. Each new stop counts as a trip.
        self._was_stopped = {"soft_estop": True, "estop": True}

    def _set_report(self, numbers: Sequence[Any]):
        # The motor commands, which are last, are unknown and stay 0.
        write_numbers(tree.tree_leaves(self._reported), numbers)

    def _datagram(self, numbers: list[float]) -> bytes:
        """Return the bytes of this tick's ITP packet. numbers: the pedal, then increment (3),
        quaternion (4) and grasp (1). Each component has two numbers: gold arm, then green arm.
        """
        pedal, *delta = map(int, numbers[:7])
        quat, grasp = numbers[7:15], map(int, numbers[15:])
        # ITP's checksum: the sum of pedal, packet number and increments, as a signed 32-bit number.
        checksum = (pedal + self._sequence + sum(delta) + 2**31) % 2**32 - 2**31
        # The zeros are the packet's type and version, and then the buttons of both arms.
        return FIELDS.pack(self._sequence, 0, 0, *delta, *quat, 0, 0, *grasp, pedal, checksum)

    def _use_report(self, report: JointReport):
        # Takes this tick's state from the robot's report, and counts new stops and trips of checks.
        report.fill(self._frame)
        frame, arms = self._frame, self.arms
        stopped = bool(frame.number("soft_estopped"))
        numbers = []
        for name, arm in itertools.product(("jpos", "mvel"), arms):
            numbers += frame[f"{arm}/{name}"].tolist()
        self._set_report([*numbers, report.runlevel, stopped])
        frame["live"] = observers.is_live(report.runlevel, stopped)
        is_stopped = {"soft_estop": stopped, "estop": report.runlevel == E_STOP}
        for check in is_stopped:
            # A robot may not report its checks, so each new stop counts as a trip.
            if is_stopped[check] and not self._was_stopped[check]:
                stops = self._outcomes.get(f"check_{check}_count", 0) + 1
                self._record_trips(check, stops, self.next_tick)
        self._was_stopped = is_stopped
        for check, (count, first_tick) in report.checks.items():
            # A robot of another version may have other checks.
            if check in _CHECKS:
                # The robot counts its own ticks, so only the time since the first trip is useful.
                first_ms = max(self.next_tick - (report.tick - first_tick), 0)
                self._record_trips(check, count, first_ms)
        counts = [count for key, count in self._outcomes.items() if key.endswith("_count")]
        frame["trips"] = sum(counts)

    def _record_trips(self, check: str, count: int, first_ms: int):
        """Raise a check's count to at least `count`, and keep the time of its first trip."""
        key = f"check_{check}_count"
        self._outcomes[key] = max(self._outcomes.get(key, 0), min(count, _MAX_TRIPS))
        self._outcomes.setdefault(f"check_{check}_first_ms", first_ms)

    def _lose_reports(self):
        # Treats the robot as stopped, because no reports arrive.
        for name in ("runlevel", "surgeon_mode", "plc_runlevel", "fault_active", "live"):
            self._frame[name] = 0
        self._reported.runlevel[0] = E_STOP
        for arm in self.arms:
            self._frame[f"{arm}/force"] = 0.0


def _resting_report(blueprint: Blueprint) -> RobotSignals:
    # Returns the report of a stopped robot at its start position.
    start = cast(blueprint.plan.program.params.start, "float32")
    mvel, dac = (tuple(Vec.full(7, zero) for _ in start) for zero in (np.float32(0.0), np.int32(0)))
    return RobotSignals(start, mvel, np.int32(E_STOP), np.int32(0), dac)


def _console_code(blueprint: Blueprint) -> StepCode:
    """Return the compiled code of the console's half of the tick. Its input is the last report. Its
    output is, for each arm, the channels `of_console` of `link.toml`; then halted_ms and the
    packet's numbers, as `DistantRobot._datagram` reads them.
    """
    setup = blueprint.setup
    params = blueprint.plan.program.params_of(blueprint.inputs[0])

    def begin(inputs) -> observers.ObserverState:
        start = cast_to_real(setup, params.start)
        tips = per_arm(setup, lambda i, arm: kinematics.forward_pose(arm, start[i]).position)
        return observers.init(setup, start, tips)

    def step(
        inputs, state: observers.ObserverState, now: Scalar, robot: RobotSignals, motion
    ) -> tuple[observers.ObserverState, list[Scalar]]:
        # Computes the packet, the nominal model, the cue and the monitor, and returns the outputs
        # that `_console_code` lists. robot: the last report.
        packet = operator.make_packet(setup, params.operator, motion, operator.row_timing(now))
        fresh = jnp.bool_(True)
        after, view = observers.update_model_and_cue(setup, params, state, packet, fresh, robot)
        updated = observers.update_monitor(
            setup, params, state.monitor, packet, fresh, robot, view, None, now
        )
        after = replace(after, monitor=updated)
        out = []
        for i, (model, cue) in enumerate(zip(view.models, view.cues, strict=True)):
            error_mm = cue.distance * 1e3
            force = (x * cue.force[0] for x in cue.direction)
            out += [*model.jpos, *view.tips[i], *model.tip_position, error_mm]
            out += [*force, view.depth[i] * 1e3]
            # A false report is unknown (NaN), because the true tip is unknown. The last two
            # arguments, which are measured tips, affect only this distance.
            origin = Vec.full(3, 0.0)
            distances = monitor.arm_distances(
                params.monitor, after.monitor.arms[i], model.tip_position, origin, origin
            )
            unintended, unintended_off, loss, _ = hazard_distances(view.live, distances)
            # `known_mm` is the reported tip's distance from the golden run, or here from the model.
            out += [unintended, unintended_off, loss, jnp.nan, error_mm]
        # Increment (3), quaternion (4) and grasp (1) of each arm. An absent arm does not move.
        moved = dict.fromkeys(ARMS, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0))
        for i, arm in enumerate(setup.arms):
            moved[arm] = *packet.delta[i], *packet.quat[i], packet.grasp[i]
        out += [after.monitor.halted, packet.surgeon_mode]
        # A packet has each component of the gold arm and then of the green arm.
        out += itertools.chain(*zip(*moved.values(), strict=True))
        return after, [jnp.float32(x) for x in out]

    def finish(inputs, state: observers.ObserverState) -> dict[str, Scalar]:
        return {"cue0_first_ms": state.haptics[0].cues[0].first_tick}

    tables = blueprint.code.tables[:1] * len(blueprint.plan.columns)
    key = trace_key.hash_values("distant", SOURCE, _SOURCE, setup, params)
    resting, cache = _resting_report(blueprint), compile_cache.object_cache()
    return StepCode(begin, step, finish, (), resting, tables, cache, key)

"""A robot elsewhere, `ravenjax robot` or a real Raven: driven over ITP, compared with the nominal model here.

The console's half of the tick runs here, compiled as the whole is: packets of the operator's motion, the nominal model
on that clean input, the cue from what the robot reports of itself. A robot that nothing is heard of counts as stopped.

Neither the true tip nor a golden run is known here. `link_jpos` and `tip` are the measured ones; the observer takes the
nominal model as its golden run, so that unintended motion and loss of motion are those of the reported tip from the
model; `known_mm` is the distance from the model, too. Of false reports nothing can be said: `false_report_mm` is NaN.
"""

from __future__ import annotations

import struct
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ravenjax.campaign import compile_cache
from ravenjax.engines.cpu.stepper import StepCode, Stepper
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.console.packet import U_STRUCT, Packet
from ravenjax.robots.raven2.geometry import kinematics, scene
from ravenjax.robots.raven2.loop import connections
from ravenjax.robots.raven2.plant import nominal
from ravenjax.robots.raven2.run_levels import E_STOP, PEDAL_DOWN
from ravenjax.robots.raven2.setup import Setup
from ravenjax.stages import haptics, monitor
from ravenjax.trainer.robot_link.joint_record import JointReport
from ravenjax.trainer.robot_link.remote import RemoteRobot
from ravenjax.trainer.session.blueprint import Blueprint, hazard_distances
from ravenjax.trainer.session.frame import Frame

_SEEN = (
    *("model_jpos", "tip", "model_tip", "error_mm", "force", "depth_mm"),
    *("unintended_mm", "unintended_off_mm", "loss_mm", "false_report_mm", "known_mm"),
)
"""Channels of an arm that the half tick fills, in this order."""
_UM_PER_M = 1e6
_U_FIELDS = struct.Struct("<3I6i8d2i2i2i")
assert _U_FIELDS.size == U_STRUCT.itemsize


@record
class _State:
    nominal: tuple[nominal.State, ...]
    haptics: tuple[haptics.State, ...]
    monitor: monitor.State


class DistantRobot:
    """As `simulation.Robot`, for a session; the robot itself is at the other end of `remote`."""

    def __init__(self, blueprint: Blueprint, remote: RemoteRobot) -> None:
        self.blueprint, self.remote = blueprint, remote
        self.arms = blueprint.setup.arms
        self._stepper = Stepper(_half(blueprint), ())
        self.motion = self._stepper.flat.reshape(len(self._stepper.tables), -1)
        self._frame = Frame(blueprint.layout)
        self.row = self._frame.row[: blueprint.layout.simulated]
        self.now = 0
        self._out = np.zeros(self._stepper.code.outputs, np.float32)
        self._live = self._stepper.entering[-1]  # as the robot reported last
        code = self._stepper.code
        leaves = jax.tree.unflatten(jax.tree.structure(code.state), range(len(jax.tree.leaves(code.state))))
        self._missed = [place for arm in leaves.monitor.arms for place in arm.missed]
        self._sequence = 0
        self._places = [blueprint.layout.places[name] for name in (*_names(self.arms), "halted_ms")]
        self._outcomes: dict[str, Any] = {}
        self._at_rest()

    def step(self) -> None:
        """One tick: the model moves, the packet goes out, the newest report comes in."""
        self._stepper.step(self.now, self._out.ctypes.data)
        at = self._show()
        self._sequence += 1
        report = self.remote.exchange(self._datagram(self._out[at:].tolist()))
        if report is not None and not self.remote.stale:
            self._take(report)
        else:
            self._lose()
        self._frame["tick"] = self.now
        self.now += 1

    def outcomes(self) -> dict[str, Any]:
        """The few outcome columns that can be known here."""
        return dict(self._outcomes)

    def golden_outcomes(self) -> None:
        """Of a golden run nothing is known here."""
        return None

    def reset(self) -> None:
        """Ask the robot to begin anew; the model does."""
        self.remote.order({"order": "reset"})
        self._stepper.begin()
        self._at_rest()
        self.now, self._outcomes = 0, {}
        self._frame["trips"] = 0

    def arm(self, row: int) -> None:
        """Let the hazard of this row strike in the robot's process."""
        self._stepper.write(self._missed, [0.0] * len(self._missed))
        self.remote.order({"order": "arm", "number": row})

    def disarm(self) -> None:
        """Take it back."""
        self.remote.order({"order": "disarm"})

    def press(self, row: int, ticks: int = 100) -> None:
        """Press the E-stop button of the robot's process."""
        self.remote.order({"order": "estop"})

    def _at_rest(self) -> None:
        """Until the robot reports, it counts as standing where it begins."""
        for i, start in enumerate(self.blueprint.plan.program.params.start):
            for place, number in zip(self._stepper.entering[14 * i : 14 * i + 14], [*start, *[0.0] * 7], strict=True):
                place[0] = number
        self._live[0] = 0
        self._stopped: dict[str, bool] = dict.fromkeys(
            ("soft_estop", "estop"), True
        )  # checks, in the last report: entering counts

    def _show(self) -> int:
        """Fill the row with what the half tick told; where the packet begins in it."""
        at = 0
        for place in self._places:
            size = place.stop - place.start
            self.row[place] = self._out[at : at + size]
            at += size
        return at

    def _datagram(self, numbers: list[float]) -> bytes:
        """The 124 bytes of this tick's packet: pedal, then increments, quaternion and grasp of each arm."""
        delta, quat, grasp = [0] * 6, [0.0] * 6 + [1.0] * 2, [0] * 2
        for i, arm in enumerate(self.arms):
            slot, first = ARMS.index(arm), 1 + 8 * i
            delta[slot::2] = [int(x) for x in numbers[first : first + 3]]
            quat[slot::2] = numbers[first + 3 : first + 7]
            grasp[slot] = int(numbers[first + 7])
        mode = int(numbers[0])
        total = (mode + self._sequence + sum(delta) + 2**31) % 2**32 - 2**31
        return _U_FIELDS.pack(self._sequence, 0, 0, *delta, *quat, 0, 0, *grasp, mode, total)

    def _take(self, report: JointReport) -> None:
        report.fill(self._frame)
        entering = self._stepper.entering
        for i, arm in enumerate(self.arms):
            numbers = [*self._frame[f"{arm}/jpos"].tolist(), *self._frame[f"{arm}/mvel"].tolist()]
            for place, number in zip(entering[14 * i : 14 * i + 14], numbers, strict=True):
                place[0] = number
        stopped = bool(self._frame.number("soft_estopped"))
        self._set_live(report.runlevel == PEDAL_DOWN and not stopped)
        for check, trips in (("soft_estop", stopped), ("estop", report.runlevel == E_STOP)):
            if trips and not self._stopped[check]:
                self._outcomes.setdefault(f"check_{check}_first_ms", self.now)
                count = f"check_{check}_count"
                self._outcomes[count] = self._outcomes.get(count, 0) + 1
                self._frame["trips"] = self._frame.number("trips") + 1
            self._stopped[check] = trips

    def _lose(self) -> None:
        """Nothing is heard of the robot: it counts as stopped, and nobody is pulled toward it."""
        for name in ("runlevel", "surgeon_mode", "plc_runlevel", "fault_active"):
            self._frame[name] = 0
        self._set_live(False)
        for arm in self.arms:
            self._frame[f"{arm}/force"] = 0.0

    def _set_live(self, live: bool) -> None:
        self._frame["live"] = live
        self._live[0] = -int(live)


def _names(arms: tuple[str, ...]) -> list[str]:
    return [f"{arm}/{name}" for arm in arms for name in _SEEN]


def _half(blueprint: Blueprint) -> StepCode:
    """The compiled half.

    What enters a tick is what the robot reported last: joints (7) and motor velocities (7) of each arm, whether it is
    live.
    """
    setup, params = blueprint.setup, blueprint.plan.program.params
    columns = len(blueprint.plan.columns)
    start = params.start

    def begin(inputs: Any) -> _State:
        tips = per_arm(setup, lambda i, arm: kinematics.forward(arm, real(setup, start[i])).position)
        return _State(
            tuple(nominal.init(setup, arm, params.nominal[i], start[i]) for i, arm in enumerate(setup.arms)),
            tuple(haptics.init(setup, params.haptics) for _ in setup.arms),
            monitor.init(setup, tips, tuple(tip * _UM_PER_M for tip in tips)),
        )

    def step(inputs: Any, state: _State, now: Scalar, entering: Any, motion: Any) -> tuple[_State, list[Scalar]]:
        packet = connections.packet(setup, params.operator, None, motion, None, None, now)
        told = [[Vec(entering[14 * i + 7 * part :][:7]) for part in (0, 1)] for i in range(len(setup.arms))]
        models = per_arm(
            setup,
            lambda i, arm: nominal.step(
                setup,
                arm,
                params.nominal[i],
                state.nominal[i],
                connections.clean(setup, packet, jnp.bool_(True), i),
                told[i][0],
            ),
        )
        model_tips = tuple(model.tip_position for _, model in models)
        signals = [connections.felt(setup, arm, i, models[i][1], *told[i]) for i, arm in enumerate(setup.arms)]
        tips = tuple(signal.robot_position for signal in signals)
        observer = _observe(setup, params.monitor, state.monitor, packet, tips, model_tips, entering[-1], now)
        out: list[Scalar] = []
        cues = []
        for i, arm in enumerate(setup.arms):
            moved, cue = haptics.step(setup, params.haptics, state.haptics[i], signals[i])
            cues.append(moved)
            distance = cue.distance * 1e3
            out += [*models[i][1].jpos, *tips[i], *model_tips[i], distance]
            out += [*(x * cue.force[0] for x in cue.direction), scene.tissue_depth(arm, tips[i]) * 1e3]
            still = Vec.full(3, 0.0)
            off = monitor.distances(params.monitor, observer.arms[i], model_tips[i], still, still)
            unintended, unintended_off, loss, _ = hazard_distances(entering[-1], off)
            out += [unintended, unintended_off, loss, jnp.nan, distance]
        out += [observer.halted, packet.surgeon_mode]
        for i in range(len(setup.arms)):
            out += [*packet.delta[i], *packet.quat[i], packet.grasp[i]]
        return _State(tuple(model for model, _ in models), tuple(cues), observer), [jnp.float32(x) for x in out]

    def finish(inputs: Any, state: _State) -> dict[str, Scalar]:
        return {"cue0_first_ms": state.haptics[0].cues[0].first_tick}

    length = blueprint.code.tables[0]
    rest = [np.float32(x) for i in range(len(setup.arms)) for x in (*start[i], *([0.0] * 7))]
    rest = [*rest, np.bool_(False)]
    return StepCode(begin, step, finish, (), rest, (length,) * columns, compile_cache.objects())


def _observe(
    setup: Setup,
    params: monitor.Params,
    state: monitor.State,
    packet: Packet,
    tips: tuple[Vec, ...],
    model_tips: tuple[Vec, ...],
    live: Scalar,
    now: Scalar,
) -> monitor.State:
    """The observer, of what is known here: the reported tip as the true one, the model as the golden run."""
    none = per_arm(setup, lambda i, arm: Vec.full(7, jnp.int32(0)))
    signal = monitor.Signal(
        tip=tips,
        pos=tuple(tip * _UM_PER_M for tip in tips),
        model_tip=model_tips,
        depth=per_arm(setup, lambda i, arm: scene.tissue_depth(arm, tips[i])),
        distance=scene.tip_distance(setup.arms, tips),
        dac=none,
        fresh=jnp.bool_(True),
        live=live,
        pedal=packet.surgeon_mode != 0,
        tick=now,
    )
    golden = monitor.Reference(model_tips, tuple(tip * _UM_PER_M for tip in model_tips))
    return monitor.step(setup, params, state, signal, golden)

"""Stages of the control software whose text is a file of one's own: what such a file sees, and what
frames it.

    stage           step(params, state, view) gives         the frame that stays
    motor_control   (state, tau_d): 7 N m at the capstan    below run level 2 the last torques are held
    dac             (state, current_cmd): 7 int32 counts    16 bits; without enabled DACs, or in an E-stop, none of it

One arm, one millisecond. What a stage remembers is what `init` gives, and goes on in each
millisecond. A file that writes the built-in law gives the built-in's bits. The frame is what the
rest of the robot relies on: no file can make an E-stop pass a command.
"""  # noqa: E501

from __future__ import annotations

from typing import Any

from ravenjax.numbers.setup import per_arm
from ravenjax.numbers.vec import Scalar, Vec, record, replace, where
from ravenjax.parts import parameters, part
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import dac, motor_control
from ravenjax.robots.raven2.stages.motor_control import MotorControlParams, MotorControlState

MOTOR_CONTROL, DAC = "motor_control", "dac"
STAGES = (MOTOR_CONTROL, DAC)
"""Stages that a file may replace, in the order of the tick."""

OwnStates = tuple[tuple[Any, ...], ...]
"""What replaced stages remember: of each, in the order of `RavenSetup.controller`, one entry an
arm.
"""


@record
class MotorControlView:
    """What a file in place of motor control sees."""

    active: Scalar  # bool, run level 2 and above
    pedal_down: Scalar  # bool, run level 3
    mpos_d: Vec  # 7 rad
    mpos: Vec  # 7 rad
    mvel: Vec  # 7 rad/s
    jpos: Vec  # 7, rad and m
    tau_g: Vec  # 3 N m at the capstan, gravity of joints 1-3 at jpos; 0 in the 2015 fork
    period: Scalar  # s
    kp: Vec  # 7 N m/rad; this and the next three as the campaign has them at control.motor_control
    kd: Vec  # 7 N m s/rad
    ki: Vec  # 7 N m/(rad s)
    mvel_d: Vec  # 7 rad/s


@record
class DacView:
    """What a file in place of the DAC conversion sees."""

    tau_d: Vec  # 7 N m at the capstan
    amps_per_torque: Vec  # 7 A/(N m)
    counts_per_amp: Vec  # 7 DAC counts/A


def params(setup: RavenSetup) -> Any:
    """What the files say, by stage; None where none is replaced."""
    return (
        parameters.of(tuple(source for _, source in setup.controller)) if setup.controller else None
    )


def init(setup: RavenSetup, params: Any) -> OwnStates | None:
    """What the files begin with."""
    if params is None:
        return None
    return tuple(
        (part.init(part.loaded(source), own, setup.precision.narrow),) * len(setup.arms)
        for (_, source), own in zip(setup.controller, params, strict=True)
    )


class Replaced:
    """The replaced stages of one cycle."""

    def __init__(self, setup: RavenSetup, params: Any, states: OwnStates | None) -> None:
        self._setup, self._params = setup, params
        self._states = list(states or ())
        self._places = {stage: place for place, (stage, _) in enumerate(setup.controller)}

    @property
    def states(self) -> OwnStates | None:
        """What is remembered after this cycle."""
        return tuple(self._states) if self._places else None

    def __contains__(self, stage: str) -> bool:
        return stage in self._places

    def torques(
        self,
        params: tuple[MotorControlParams, ...],
        states: tuple[MotorControlState, ...],
        active: Scalar,
        pedal_down: Scalar,
        mpos_d: tuple[Vec, ...],
        measured: tuple[tuple[Vec, Vec, Vec], ...],
    ) -> tuple[MotorControlState, ...]:
        """As `motor_control.torques`, of every arm; measured: (jpos, mpos, mvel)."""
        setup = self._setup

        def of_arm(i: int, arm: ArmName) -> MotorControlView:
            (jpos, mpos, mvel), gains = measured[i], params[i]
            lift = (
                motor_control.gravity(setup, arm, jpos)
                if setup.software == "raven2"
                else Vec((0.0, 0.0, 0.0))
            )
            return MotorControlView(
                active,
                pedal_down,
                mpos_d[i],
                mpos,
                mvel,
                jpos,
                lift,
                stored.PERIOD,
                gains.kp,
                gains.kd,
                gains.ki,
                gains.mvel_d,
            )

        views = per_arm(setup, of_arm)
        torques = self._stepped(MOTOR_CONTROL, views, "tau_d", tuple(one.tau_d for one in states))
        return tuple(
            replace(
                before,
                mpos_d=where(active, target, before.mpos_d),
                tau_d=where(active, tau, before.tau_d),
                tau_g=(
                    where(active, view.tau_g, before.tau_g)
                    if setup.software == "raven2"
                    else before.tau_g
                ),
            )
            for before, target, tau, view in zip(states, mpos_d, torques, views, strict=True)
        )

    def commands(
        self, tau_d: tuple[Vec, ...], live: Scalar, resting: tuple[Vec, ...]
    ) -> tuple[Vec, ...]:
        """As `dac.step`, of every arm."""
        setup = self._setup

        def view(i: int, arm: ArmName) -> DacView:
            amps = stored.amps_per_torque(arm, setup.tools[i], setup.software)
            return DacView(tau_d[i], Vec(amps), Vec(transmission.COUNTS_PER_AMP))

        counts = self._stepped(DAC, per_arm(setup, view), "current_cmd", resting)
        return tuple(
            dac.stored_counts(new, live, rest) for new, rest in zip(counts, resting, strict=True)
        )

    def _stepped(
        self, stage: str, views: tuple[Any, ...], name: str, like: tuple[Vec, ...]
    ) -> tuple[Vec, ...]:
        place, width = self._places[stage], self._setup.precision.narrow
        code, own = part.loaded(self._setup.controller[place][1]), self._params[place]
        before = self._states[place]
        arms = [
            part.stage_step(code, own, state, view, width, name, one)
            for state, view, one in zip(before, views, like, strict=True)
        ]
        self._states[place] = tuple(after for after, _ in arms)
        return tuple(values for _, values in arms)

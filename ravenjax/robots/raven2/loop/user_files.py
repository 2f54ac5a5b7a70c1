"""Runs users' files in the Raven's tick: defines what they can read, and what their results do.

In each millisecond a file gets a *view* of one arm: the signals that the tick has computed so far
(docs/how-to/own-check.md lists them). The view contains nothing that only the simulator knows, such
as the true tip or the fault.

**Checks** run between two stages, so that they act before the next stage reads. A check acts as

- `watch`: changes nothing, and does not count as a response.
- `flag`: raises an alarm. The robot continues.
- `limit`: on an arm where the check trips, the third result of `step` replaces the signal. A packet
  is dropped for both arms, whose increments are in one datagram.
- `stop` in the control software: acts as the overdrive check. The software E-stop is raised in this
  cycle, and the arm's command of this cycle is 0. The watchdog's square wave ends, so the PLC trips
  and closes the brakes.
- `stop` at the boards, which have no software E-stop: the board of an arm whose check trips puts 0
  on its DACs and holds its watchdog pin constant, so that the PLC trips 75 ms later. It does so
  until the PLC has been started again (run level init).

**Stages** of the control software may be files:

    stage           results of step(params, state, view)    what the software still enforces
    motor_control   (state, tau_d): 7 capstan torques, N m  below run level 2 the last torques
                                                            are held
    dac             (state, current_cmd): 7 int32 counts    16 bits; no command without enabled
                                                            DACs or in an E-stop

A file that repeats the built-in law gives the same bits. No file can make a command pass an E-stop.
"""

from collections.abc import Sequence
from functools import reduce
from operator import and_, or_
from typing import Any

from ravenjax.numbers import cast_to_real, for_each_arm, jnp, narrow_numbers, per_arm
from ravenjax.numbers.vec import Scalar, Vec, cast, clamp, record, replace, where
from ravenjax.parts import part
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.run_levels import E_STOP, INIT, PIN_WATCHDOG
from ravenjax.robots.raven2.setup import PerArm, RavenSetup, map_arms
from ravenjax.robots.raven2.stages import dac, motor_control, usb
from ravenjax.stages import check

PACKET, BOARDS = "packet", "usb_out"
COMMANDS = ("current_cmd", "checked_cmd")
"""Seams at which a check that stops must also set the command of this cycle to 0."""

MOTOR_CONTROL, DAC = "motor_control", "dac"
"""Stages that a file may replace, in the order of the tick."""

_WATCHDOG_BIT = 1 << PIN_WATCHDOG


@record
class CheckParams:
    """Check parameters that a campaign may vary, by the check's name."""

    own: tuple[Any, ...]  # parameter record of each file, or None
    threshold: tuple[Scalar, ...]  # in the unit of the check's score


@record
class CheckState:
    """A check's state for one arm."""

    file_state: Any  # state that the file's `init` or `step` returned
    recent: Vec  # scores of the last `consecutive` - 1 ticks, latest first


@record
class UserFilesState:
    """State of checks and stages; empty without them."""

    checks: tuple[PerArm[CheckState], ...]  # for each check
    histories: tuple[check.CheckHistory, ...]
    refusing: PerArm[Scalar]  # bool, a check has stopped the arm's board; (): no such check
    stages: tuple[tuple[Any, ...], ...]  # state of each in the order of `RavenSetup.controller`


def check_params(setup: RavenSetup, thresholds: Sequence[float]) -> CheckParams:
    """Return the parameters of the users' checks. thresholds: one per check."""
    names = tuple(use.name for use in setup.checks)
    records = part.part_parameters(tuple(use.part for use in setup.checks))
    return CheckParams(records, part.named_parameters(names, thresholds))


def init(setup: RavenSetup, checks: CheckParams, stages: Any) -> UserFilesState:
    """Return the state before the first tick. stages: parameter record of each replaced stage."""
    check_states = []
    for use, params in zip(setup.checks, checks.own, strict=True):
        recent = Vec.full(use.consecutive - 1, cast_to_real(setup, 0.0))
        file_state = part.load_part(use.part).init(params, setup.precision.real)
        check_states.append(for_each_arm(setup, CheckState(file_state, recent)))
    stage_states = []
    for (_, source), params in zip(setup.controller, stages or (), strict=True):
        file_state = part.load_part(source).init(params, setup.precision.narrow)
        stage_states.append(for_each_arm(setup, file_state))
    return UserFilesState(
        checks=tuple(check_states),
        histories=(check.init(setup),) * len(setup.checks),
        refusing=for_each_arm(setup, jnp.bool_(False)) if boards_may_refuse(setup) else (),
        stages=tuple(stage_states),
    )


def boards_may_refuse(setup: RavenSetup) -> bool:
    """Return whether a check may stop a single board, whose pins then differ from the other's."""
    return any(use.at == BOARDS and use.acts == "stop" for use in setup.checks)


class UserFiles:
    """Users' files in one tick, and the signals of the tick so far, which the files read."""

    def __init__(
        self,
        setup: RavenSetup,
        checks: CheckParams | None = None,
        stages: Any = None,
        state: UserFilesState | None = None,
        tick: Scalar = 0,
    ):
        self._setup, self._checks, self._stages = setup, checks or CheckParams((), ()), stages
        self._tick, self.state = tick, state or UserFilesState((), (), (), ())
        self._signals: dict[str, Any] = {"tick": tick}
        # bool of each check in the control software that stops: whether it trips in this tick
        self._stops: list[Scalar] = []

    def _store(self, field: str, index: int, item):
        # Replaces one item of a tuple in the state.
        items = list(getattr(self.state, field))
        items[index] = item
        self.state = replace(self.state, **{field: tuple(items)})

    def note(self, **numbers: Any) -> None:
        """Store signals for the views of files: numbers, or tuples with one entry per arm."""
        self._signals.update(numbers)

    def views(self, at: str, dtype: str) -> PerArm[part.View]:
        """Return the view of each arm at a point of the tick. dtype: type of the floats."""

        def view(i: int, _) -> part.View:
            # Returns the view of arm i, with its entry of each signal that has one entry per arm.
            numbers = {}
            for name, value in self._signals.items():
                # A `Vec` is a subclass of tuple, but it has one entry per joint.
                number = value[i] if type(value) is tuple else value
                numbers[name] = cast(number, dtype) if name in _FLOATS else number
            return part.View(at, numbers)

        return per_arm(self._setup, view)

    def check_packet(self, packet: Packet) -> Packet:
        """Return the packet after users' checks. A check that limits drops the packet."""
        # Users' files do not get the rotation of the hands.
        self.note(**{name: value for name, value in vars(packet).items() if name != "quat"})
        # A check of packets has no signal to replace.
        no_signal = tuple(Vec(()) for _ in self._setup.arms)
        for index, use in self._checks_at(PACKET):
            arms_trip, _ = self._run_check(index, no_signal)
            trips = reduce(or_, arms_trip)
            if use.acts == "limit":
                packet = replace(packet, received=jnp.where(trips, 0, packet.received))
                self.note(received=packet.received)
            elif use.acts == "stop":
                self._stops.append(trips)
        return packet

    def check(self, seam: str, signal: PerArm[Vec]) -> PerArm[Vec]:
        """Return the signal after the checks at a seam of the control software, one Vec per arm.

        A check that stops sets commands of its arm to 0 and is stored in `_stops`. By this list,
        `stop` and `allow` stop the robot later in the tick.
        """
        # `note` adds the signal to the views of files, before and after each check.
        name = "current_cmd_checked" if seam == "checked_cmd" else seam
        self.note(**{name: signal})
        for index, use in self._checks_at(seam):
            # A check computes in the type of the tick. Signals in _FLOATS have the type `narrow`.
            crossing = cast_to_real(self._setup, signal) if name in _FLOATS else signal
            trips, values = self._run_check(index, crossing)
            if use.acts == "limit":
                if seam in COMMANDS:
                    signal = _limit_commands(trips, values, signal)
                else:
                    signal = _where_tripped(trips, narrow_numbers(self._setup, values), signal)
            elif use.acts == "stop":
                self._stops.append(reduce(or_, trips))
                if seam in COMMANDS:
                    signal = _where_tripped(trips, _zeros(signal), signal)
            self.note(**{name: signal})
        return signal

    def allow(self, live: Scalar) -> Scalar:
        """Return `live`, or False if a check has stopped the robot earlier in this tick."""
        return reduce(lambda allowed, stop: allowed & ~stop, self._stops, live)

    def stop(self, tripped: Scalar) -> Scalar:
        """Return whether the software E-stop is raised: `tripped`, or a check stops the robot."""
        return reduce(or_, self._stops, tripped)

    def check_boards(
        self, held: usb.UsbOut, boards: usb.UsbOut, plc_runlevel: Scalar
    ) -> usb.UsbOut:
        """Return the values of the USB boards after users' checks.
        held: values of the boards in the last tick. boards: values that the software wrote.
        """
        self.note(held_cmd=held.current_cmd, pins=boards.pins, plc_runlevel=plc_runlevel)
        commands = boards.current_cmd
        # A board that has refused commands refuses them until the PLC is started again.
        refusing = tuple(refuses & (plc_runlevel != INIT) for refuses in self.state.refusing)
        for index, use in self._checks_at(BOARDS):
            self.note(boards_cmd=commands)
            trips, values = self._run_check(index, commands)
            if use.acts == "limit":
                commands = _limit_commands(trips, values, commands)
            elif use.acts == "stop":
                refusing = tuple(map(or_, refusing, trips))
        pins = boards.pins
        if refusing:
            self.state = replace(self.state, refusing=refusing)
            # The PLC stops the robot if the watchdog bit no longer alternates, so a board that
            # refuses holds its bit. In an E-stop the bit alternates, or the PLC could not start.
            holds_wave = [refuses & (plc_runlevel != E_STOP) for refuses in refusing]
            commands = _where_tripped(refusing, _zeros(commands), commands)
            pins = tuple(
                (new & ~_WATCHDOG_BIT) | (jnp.where(holds, old, new) & _WATCHDOG_BIT)
                for holds, new, old in zip(holds_wave, pins, held.pins, strict=True)
            )
        self.note(boards_cmd=commands)
        return usb.UsbOut(commands, pins)

    def _checks_at(self, seam: str) -> list[tuple[int, Any]]:
        # Returns index and description of each check at a seam.
        return [(index, use) for index, use in enumerate(self._setup.checks) if use.at == seam]

    def _run_check(self, index: int, crossing: PerArm[Vec]) -> tuple[PerArm[Scalar], PerArm[Vec]]:
        """Run one check in this millisecond, and store its state and history.
        crossing: signal at the check's seam, one Vec per arm; empty for a check of packets. Returns
        for each arm whether the check trips, and the values of a check that limits; if a check does
        not limit, `crossing`.
        """
        use, real = self._setup.checks[index], self._setup.precision.real
        code, params = part.load_part(use.part), self._checks.own[index]
        threshold, views = self._checks.threshold[index], self.views(use.at, real)
        states, trips, margins, values = [], [], [], list(crossing)
        for i, before in enumerate(self.state.checks[index]):
            # The form that the results of the user's `step` must have, besides the state.
            expected: dict[str, Any] = {"score": part.SCORE}
            if use.acts == "limit" and crossing[i]:
                expected["values"] = crossing[i]
            file_state, score, *limited = code.step(
                params, before.file_state, views[i], real, **expected
            )
            # Only a check that limits returns values.
            values[i] = limited[0] if limited else crossing[i]
            # Thresholds are not negative, so a score that is NaN never trips.
            score = jnp.where(score == score, score, 0.0)
            # A check trips if all of its last `consecutive` scores exceed the threshold.
            scores = [score, *before.recent]
            lowest = reduce(jnp.minimum, scores)
            states.append(CheckState(file_state, Vec(scores[: len(before.recent)])))
            trips.append(lowest > threshold)
            margins.append(threshold - lowest)
        self._store("checks", index, tuple(states))
        tripped, margin = reduce(or_, trips), reduce(jnp.minimum, margins)
        history = self.state.histories[index]
        self._store("histories", index, check.update_check(history, self._tick, tripped, margin))
        return tuple(trips), tuple(values)

    def replaces(self, stage: str) -> bool:
        """Return whether a file replaces that stage."""
        return stage in dict(self._setup.controller)

    def step_motor_control(
        self,
        params: PerArm[motor_control.MotorControlParams],
        states: PerArm[motor_control.MotorControlState],
        active: Scalar,
        pedal_down: Scalar,
        mpos_d: PerArm[Vec],
        jpos: PerArm[Vec],
    ) -> PerArm[motor_control.MotorControlState]:
        """Return every arm's state with the torques of a user's file, in place of `motor_torques`.
        Without `active` (bool, run level 2 or 3), targets and torques keep their last values.
        """
        setup, has_gravity = self._setup, self._setup.software == "raven2"
        gravity = for_each_arm(setup, Vec.full(3, 0.0))
        if has_gravity:
            gravity = map_arms(setup, motor_control.gravity_torques, jpos)
        gains = "kp", "kd", "ki", "mvel_d"
        self.note(
            active=active,
            pedal_down=pedal_down,
            mpos_d=mpos_d,
            tau_g=gravity,
            period=stored.PERIOD,
            **{name: tuple(getattr(arm, name) for arm in params) for name in gains},
        )
        torques = self._step_stage(MOTOR_CONTROL, "tau_d", [state.tau_d for state in states])
        new_states = []
        for i, before in enumerate(states):
            new = replace(
                before,
                mpos_d=where(active, mpos_d[i], before.mpos_d),
                tau_d=where(active, torques[i], before.tau_d),
            )
            if has_gravity:
                new = replace(new, tau_g=where(active, gravity[i], before.tau_g))
            new_states.append(new)
        return tuple(new_states)

    def step_dac(self, live: Scalar, resting: PerArm[Vec]) -> PerArm[Vec]:
        """Return every arm's DAC counts from a user's file; `resting` unless `live` (bool)."""
        setup = self._setup
        self.note(
            amps_per_torque=tuple(
                Vec(stored.amps_per_torque(*arm, setup.software))
                for arm in zip(setup.arms, setup.tools, strict=True)
            ),
            counts_per_amp=transmission.COUNTS_PER_AMP,
        )
        counts = self._step_stage(DAC, "current_cmd", resting)
        return tuple(
            dac.stored_counts(new, live, rest) for new, rest in zip(counts, resting, strict=True)
        )

    def _step_stage(self, stage: str, name: str, examples: Sequence[Vec]) -> list[Vec]:
        # Runs the user's file in place of a stage of the control software, and returns the result
        # `name` for each arm. examples: values with the form that the result must have.
        # `controller`: pairs (stage, file). Parameters and states have the same order.
        index = list(dict(self._setup.controller)).index(stage)
        _, source = self._setup.controller[index]
        code, dtype = part.load_part(source), self._setup.precision.narrow
        params, old_states = self._stages[index], self.state.stages[index]
        states, values = [], []
        for i, view in enumerate(self.views(stage, dtype)):
            state, value = code.step(params, old_states[i], view, dtype, **{name: examples[i]})
            states.append(state)
            values.append(value)
        self._store("stages", index, tuple(states))
        return values


_FLOATS = ("mpos", "mvel", "jpos", "jvel", "jpos_d", "mpos_d", "tau_d")


def _zeros(signal: PerArm[Vec]) -> PerArm[Vec]:
    return tuple(Vec.full(len(command), 0) for command in signal)


def _where_tripped(
    trips: Sequence[Scalar], values: PerArm[Vec], signal: PerArm[Vec]
) -> PerArm[Vec]:
    return tuple(map(where, trips, values, signal))


def _limit_commands(
    trips: Sequence[Scalar], values: PerArm[Vec], commands: PerArm[Vec]
) -> PerArm[Vec]:
    """Return commands after a check that limits: where it trips, `values` saturated to 16 bits.
    Commands of an arm that are all 0 stay 0, so that no check cancels an E-stop.
    """
    nonzero = (reduce(or_, (x != 0 for x in command)) for command in commands)
    limited = list(map(and_, trips, nonzero))
    saturated = tuple(value.map(lambda x: clamp(x, dac.LOWEST, dac.HIGHEST)) for value in values)
    return _where_tripped(limited, saturated, commands)

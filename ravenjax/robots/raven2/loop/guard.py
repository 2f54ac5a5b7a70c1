"""Checks of one's own at the seams of the Raven's tick, and what they do there by the robot's own
means.

In the control software `stop` is what the overdrive check does: the software E-stop is raised in
this cycle, which silences the watchdog's wave at once, and the arm's command of this cycle is 0.
Before the DAC conversion the raised flag does that, behind it the command is replaced. The PLC then
misses the wave, trips, and closes the brakes.

At the boards there is no software E-stop to raise. An arm's board that trips refuses: it puts 0 on
its DACs, and its watchdog pin stands still, so that the PLC trips 75 ms later. It goes on refusing
until the PLC has been started again (run level init), and passes the wave on from E-stop on,
without which nobody could start. Each board decides by itself.

`limit` is what a clipped command is: other numbers go on, nobody is told. A packet that is limited
is dropped as the network layer drops one, for both arms, whose increments are in one datagram; so
no numbers are asked of a check there.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import narrow, per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, record, replace, where
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.loop.check_view import CheckView
from ravenjax.robots.raven2.run_levels import E_STOP, INIT
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import dac, plc, usb
from ravenjax.stages import check, own_checks
from ravenjax.stages.check import CheckHistory
from ravenjax.stages.own_checks import OwnCheckArmState, OwnCheckParams, OwnCheckTrip
from ravenjax.vocabulary.checks import OWN

PACKET, BOARDS = "packet", "usb_out"
COMMANDS = ("current_cmd", "checked_cmd")
"""Seams where a stop makes the command of this cycle 0 by itself."""


@record
class GuardState:
    """What the checks remember."""

    checks: tuple[tuple[OwnCheckArmState, ...], ...]  # of each check, one entry an arm
    histories: tuple[CheckHistory, ...]
    refusing: (
        tuple[Scalar, ...] | None
    )  # bool, the arm's board does; None: no check may stop the robot there


class Unguarded:
    """A tick without checks of one's own."""

    def sees(self, **numbers: Any) -> None:
        """Note what has crossed: a number, or a tuple with one entry an arm."""

    def packet(self, packet: Packet) -> Packet:
        """What the network layer takes."""
        return packet

    def passes(self, seam: str, signal: tuple[Vec, ...]) -> tuple[Vec, ...]:
        """What goes on from a seam of the control software, one Vec an arm."""
        return signal

    def allows(self, live: Scalar) -> Scalar:
        """Whether the DACs get a command: `live`, unless a check before them has stopped the
        robot in this cycle.
        """
        return live

    def stops(self, tripped: Scalar) -> Scalar:
        """Whether the software E-stop is raised in this cycle: `tripped`, or by a check."""
        return tripped

    def boards(self, held: usb.UsbOut, boards: usb.UsbOut, plc_runlevel: Scalar) -> usb.UsbOut:
        """What the boards hold: what arrived there, unless a check refuses it. held: a
        millisecond ago.
        """
        return boards

    @property
    def state(self) -> GuardState | None:
        """What is remembered after this tick."""
        return None


UNGUARDED = Unguarded()


class Guard(Unguarded):
    """The checks of a campaign in one tick."""

    def __init__(
        self, setup: RavenSetup, params: OwnCheckParams, state: GuardState, tick: Scalar
    ) -> None:
        self._setup, self._params, self._before, self._tick = setup, params, state, tick
        self._after, self._histories = list(state.checks), list(state.histories)
        self._refusing = state.refusing
        self._numbers: list[dict[str, Any]] = [{"tick": tick} for _ in setup.arms]
        self._stops: list[Scalar] = []

    def sees(self, **numbers: Any) -> None:
        """Note what has crossed: a number, or a tuple with one entry an arm."""
        for name, value in numbers.items():
            each = isinstance(value, tuple) and not isinstance(value, Vec)
            for i, arm in enumerate(self._numbers):
                own = value[i] if each else value
                arm[name] = real(self._setup, own) if name in _FLOATS else own

    def packet(self, packet: Packet) -> Packet:
        """What the network layer takes."""
        self.sees(
            received=packet.received,
            sequence=packet.sequence,
            size=packet.size,
            delta=packet.delta,
            grasp=packet.grasp,
            surgeon_mode=packet.surgeon_mode,
        )
        nothing = tuple(Vec(()) for _ in self._setup.arms)
        for place, use in self._at(PACKET):
            trip = self._look(place, PACKET, nothing)
            if use.acts == "limit":
                packet = replace(packet, received=jnp.where(_any(trip.trips), 0, packet.received))
                self.sees(received=packet.received)
            elif use.acts == "stop":
                self._stops.append(_any(trip.trips))
        return packet

    def passes(self, seam: str, signal: tuple[Vec, ...]) -> tuple[Vec, ...]:
        """What goes on from a seam of the control software, one Vec an arm."""
        name = _FIELDS.get(seam, seam)
        self.sees(**{name: signal})
        for place, use in self._at(seam):
            trip = self._look(place, seam, signal)
            if use.acts == "limit":
                values = narrow(self._setup, trip.values) if name in _FLOATS else trip.values
                signal = (
                    _limited(trip, signal)
                    if seam in COMMANDS
                    else _chosen(trip.trips, values, signal)
                )
            elif use.acts == "stop":
                self._stops.append(_any(trip.trips))
                if seam in COMMANDS:
                    signal = _chosen(trip.trips, _zeros(signal), signal)
            self.sees(**{name: signal})
        return signal

    def allows(self, live: Scalar) -> Scalar:
        """Whether the DACs get a command: `live`, unless a check before them has stopped the
        robot in this cycle.
        """
        return reduce(lambda still, stop: still & ~stop, self._stops, live)

    def stops(self, tripped: Scalar) -> Scalar:
        """Whether the software E-stop is raised in this cycle: `tripped`, or by a check."""
        return reduce(lambda a, b: a | b, self._stops, tripped)

    def boards(self, held: usb.UsbOut, boards: usb.UsbOut, plc_runlevel: Scalar) -> usb.UsbOut:
        """What the boards hold: what arrived there, unless a check refuses it. held: a
        millisecond ago.
        """
        self.sees(held_cmd=held.current_cmd, pins=boards.pins, plc_runlevel=plc_runlevel)
        commands, refusing = boards.current_cmd, self._refusing
        if refusing is not None:
            refusing = tuple(still & (plc_runlevel != INIT) for still in refusing)
        for place, use in self._at(BOARDS):
            self.sees(boards_cmd=commands)
            trip = self._look(place, BOARDS, commands)
            if use.acts == "limit":
                commands = _limited(trip, commands)
            elif use.acts == "stop" and refusing is not None:
                refusing = tuple(
                    before | now for before, now in zip(refusing, trip.trips, strict=True)
                )
        if refusing is None:
            return replace(boards, current_cmd=commands)
        self._refusing = refusing
        silent = [still & (plc_runlevel != E_STOP) for still in refusing]
        return usb.UsbOut(
            _chosen(refusing, _zeros(commands), commands),
            tuple(
                (new & ~_WAVE) | (jnp.where(one, old, new) & _WAVE)
                for one, new, old in zip(silent, boards.pins, held.pins, strict=True)
            ),
        )

    @property
    def state(self) -> GuardState:
        """What is remembered after this tick."""
        return GuardState(tuple(self._after), tuple(self._histories), self._refusing)

    def _at(self, seam: str) -> list[tuple[int, Any]]:
        return [(place, use) for place, use in enumerate(self._setup.checks) if use.at == seam]

    def _look(self, place: int, seam: str, crossing: tuple[Vec, ...]) -> OwnCheckTrip:
        setup = self._setup
        width = tuple(
            real(setup, one) if _FIELDS.get(seam, seam) in _FLOATS else one for one in crossing
        )
        views = per_arm(setup, lambda i, _: CheckView(seam, self._numbers[i]))
        trip = own_checks.look(setup, self._params, self._before.checks[place], place, views, width)
        self._after[place] = trip.arms
        self._histories[place] = check.update(
            self._histories[place], self._tick, _any(trip.trips), trip.margin
        )
        return trip


def init(setup: RavenSetup, params: OwnCheckParams) -> GuardState:
    """Nothing seen, no board refuses."""
    refusing = tuple(jnp.bool_(False) for _ in setup.arms) if refuses(setup) else None
    return GuardState(
        own_checks.init(setup, params), tuple(check.init(setup) for _ in setup.checks), refusing
    )


def histories(setup: RavenSetup, state: GuardState) -> dict[str, CheckHistory]:
    """What became of each check, by its name in columns."""
    return {
        f"{OWN}{use.name}": history
        for use, history in zip(setup.checks, state.histories, strict=True)
    }


def refuses(setup: RavenSetup) -> bool:
    """Whether a board may refuse, and so its output pins be other than those of the other board."""
    return any(use.at == BOARDS and use.acts == "stop" for use in setup.checks)


_WAVE = 1 << plc.PIN_WATCHDOG
_FLOATS = ("mpos", "mvel", "jpos", "jvel", "jpos_d", "mpos_d", "tau_d")
_FIELDS = {"checked_cmd": "current_cmd_checked"}
"""Seam -> field of the view, where that has another name."""


def _zeros(signal: tuple[Vec, ...]) -> tuple[Vec, ...]:
    return tuple(Vec.full(len(one), 0) for one in signal)


def _chosen(
    trips: tuple[Scalar, ...], values: tuple[Vec, ...], signal: tuple[Vec, ...]
) -> tuple[Vec, ...]:
    """The values of the arms that trip, the signal of the others."""
    return tuple(
        where(trip, new, old) for trip, new, old in zip(trips, values, signal, strict=True)
    )


def _limited(trip: OwnCheckTrip, commands: tuple[Vec, ...]) -> tuple[Vec, ...]:
    """Commands as a check leaves them: within 16 bits, and none where there is none: no check
    passes an E-stop.
    """

    def of_arm(trips: Scalar, values: Vec, command: Vec) -> Vec:
        within = values.map(lambda value: jnp.minimum(jnp.maximum(value, dac.LOWEST), dac.HIGHEST))
        return where(trips & _any(tuple(one != 0 for one in command)), within, command)

    return tuple(of_arm(*each) for each in zip(trip.trips, trip.values, commands, strict=True))


def _any(flags: tuple[Scalar, ...]) -> Scalar:
    return reduce(lambda a, b: a | b, flags)

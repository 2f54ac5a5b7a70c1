"""Computes before a run when a Raven-II is in pedal-down and when its packets arrive.

The inputs are the operator's motion and the parameters that a campaign varies. The pedal's signal
passes from the foot through a packet to the software, from there to the PLC, and back. None of
these steps depends on a motor, so they are simulated alone, tick by tick around each change of the
foot.

Pedal-down also ends if the robot stops or if the operator lifts the foot. It does not begin again:
the PLC's trip latches, and only an operator from a user's file may press the pedal again. The time
of this press is unknown, but it is not earlier than planned.
"""

import dataclasses
import operator
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ravenjax.engines.interface import TickProgram
from ravenjax.faults.clocks import Clocks, PedalPhases
from ravenjax.faults.injection import channel_keys
from ravenjax.numbers import run_eagerly
from ravenjax.robots.raven2.loop.injector import may_restart
from ravenjax.robots.raven2.run_levels import PEDAL_DOWN, PEDAL_UP
from ravenjax.robots.raven2.stages.state_machine import MISMATCHES
from ravenjax.stages import packet_clock
from ravenjax.vocabulary.reactions import SLOW

PEDAL_SITES = ("network", "packet_header")
"""Fault sites where a fault may change the pedal, in addition to those of `may_restart`."""

LATENCY = 8
"""Most ticks from a packet until its pedal changes the run level, with a margin."""

BLOCK = 2**20
"""Number of packets whose lengths are drawn at a time."""


def trigger_clocks(
    program: TickProgram,
    columns: tuple[np.ndarray, ...],
    varied: Mapping[str, np.ndarray],
    runs: int,
) -> Clocks:
    """Return the times of packets and pedal-down in all runs, as `ravenjax.campaign.prepared` asks.

    columns: the operator's motion. varied: path of a parameter -> its values [runs].
    """
    setup, params, ticks = program.setup, program.params, program.ticks

    def numbers(path: str) -> np.ndarray:
        return np.asarray(varied.get(path, np.full(runs, operator.attrgetter(path)(params))))

    cycles = longest = np.maximum(numbers("network.cycles_per_packet").astype(np.int64), 1)
    choice = numbers("network.packets").astype(np.int64)
    if setup.packets:
        used = [np.flatnonzero(lengths) for lengths in setup.packets]
        cycles, longest = (1 + np.array([k[end] for k in used])[choice] for end in (0, -1))
    timeout = numbers("control.teleoperation.timeout_ticks")
    obeyed = numbers("control.state_machine.plc_obeyed") != 0
    slowed = np.zeros(runs, bool)
    if params.reaction is not None:
        slowed = numbers("reaction.action") == SLOW
    unknown = slowed | (longest - 1 > timeout) | (setup.hands is not None)
    cases = np.stack([cycles, longest, obeyed, unknown], axis=1)
    distinct, case = cases[:1], np.zeros(runs, np.int64)
    if (cases != distinct).any():  # sorting the rows of millions of runs takes seconds
        distinct, case = np.unique(cases, axis=0, return_inverse=True)
    foot = columns[-1].astype(np.int32) > 0
    # A simulator's packet generator ends with the robot's software E-stop
    arrivals = None
    if setup.build == "robot" and setup.packets:
        arrivals = DrawnPackets(setup.packets, choice, varied["network.packet_key"], ticks)
    elif setup.build == "robot":
        arrivals = EvenPackets(cycles, ticks)
    may_move = (key[0] in PEDAL_SITES or may_restart(*key) for key in channel_keys(setup))
    return Clocks(
        arrivals=arrivals,
        phases=tuple(
            _pedal_phases(
                setup.software,
                foot,
                shortest,
                longest_length if setup.packets else 0,
                plc,
                unknown_times,
                ticks,
            )
            for shortest, longest_length, plc, unknown_times in distinct.tolist()
        ),
        kind=case.reshape(-1),
        moved=np.array([False, *may_move]),
    )


def planned_pedal_down(
    software: str, foot: np.ndarray, cycles: int, plc: bool, ticks: int
) -> np.ndarray:
    """Return whether the robot is in pedal-down in each tick if nothing stops it, bool [ticks].

    foot: bool [rows of the motion], pedal pressed. cycles: ticks that each packet lasts. plc:
    whether the software obeys the PLC.
    """
    down = np.zeros(ticks, bool)
    phases = _pedal_phases(software, foot, cycles, 0, plc, False, ticks)
    for begin, end in zip(phases.begins.tolist(), phases.ends.tolist(), strict=True):
        down[begin - 1 : end - (end < ticks)] = True
    return down


# --- packets ---


@dataclasses.dataclass(frozen=True, eq=False)
class EvenPackets:
    """Arrival times of packets that all have the same length; as `faults.clocks.Arrivals`."""

    cycles: np.ndarray  # int64 [runs]
    ticks: int

    def arrival_ticks(self, rows: np.ndarray, packets: np.ndarray) -> np.ndarray:
        return (packets - 1) * self.cycles[rows]

    def newest(self, rows: np.ndarray) -> np.ndarray:
        return (self.ticks - 1) // self.cycles[rows] + 1


@dataclasses.dataclass(frozen=True, eq=False)
class DrawnPackets:
    """Arrival times of packets with drawn lengths; as `faults.clocks.Arrivals`."""

    shares: tuple[tuple[float, ...], ...]  # as RavenSetup.packets
    choice: np.ndarray  # int64 [runs], index in `shares`
    key: np.ndarray  # uint32 [runs]
    ticks: int

    def arrival_ticks(self, rows: np.ndarray, packets: np.ndarray) -> np.ndarray:
        # Returns the arrival ticks of packets (numbers from 1) in the runs `rows`, int64.
        wanted = np.minimum(packets, self.ticks + 1)
        result = np.empty(len(rows), np.int64)
        for indices, begin, ticks in self._drawn(rows, int(wanted.max(initial=1))):
            offset = wanted[indices] - 1 - begin
            inside = (offset >= 0) & (offset < ticks.shape[1])
            result[indices[inside]] = ticks[inside, offset[inside]]
        return result

    def newest(self, rows: np.ndarray) -> np.ndarray:
        count = np.zeros(len(rows), np.int64)
        for indices, _, ticks in self._drawn(rows, self.ticks + 1):
            count[indices] += (ticks < self.ticks).sum(axis=1)
        return count

    def _drawn(self, rows: np.ndarray, most: int) -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
        """Yield (indices in `rows`, earlier packets, arrival ticks [indices, packets])."""
        columns = min(most, 4096)
        rows_at_once = max(1, BLOCK // columns)
        for first in range(0, len(rows), rows_at_once):
            indices = np.arange(first, min(first + rows_at_once, len(rows)))
            arrival = np.zeros(len(indices), np.int64)
            key, choice = self.key[rows[indices]][:, None], self.choice[rows[indices]][:, None]
            for begin in range(0, most, columns):
                packet = np.arange(begin, min(begin + columns, most), dtype=np.int32)[None]
                with run_eagerly():
                    lengths = packet_clock.packet_length(self.shares, choice, key, packet).astype(
                        np.int64
                    )
                ends = arrival[:, None] + np.cumsum(lengths, axis=1)
                yield indices, begin, np.concatenate([arrival[:, None], ends[:, :-1]], axis=1)
                arrival = ends[:, -1]


# --- the pedal ---


def _pedal_phases(
    software: str, foot: np.ndarray, cycles: int, longest: int, plc: int, unknown: int, ticks: int
) -> PedalPhases:
    """Return the intervals in which the robot is in pedal-down.

    foot: bool [rows of the motion], pedal pressed. cycles: ticks of a packet, if lengths are not
    drawn. longest: ticks of the longest packet; 0: lengths are not drawn. plc: whether the software
    obeys the PLC. unknown: whether times depend on what happens in the run.
    """
    changes = np.flatnonzero(np.diff(foot.astype(np.int8), prepend=np.int8(0)))
    changes = changes * (1 if longest else cycles)
    changes = changes[changes < ticks]
    most_late: int | None = max(longest - 1, 0)
    if unknown or (most_late and (np.diff(changes) <= most_late + LATENCY).any()):
        most_late = None  # changes may overtake each other
    level = PEDAL_UP if software == "raven2" else PEDAL_DOWN
    turns = list(_clock_changes(changes.tolist(), level, plc, ticks))
    begins, ends = turns[0::2], turns[1::2]
    if len(ends) < len(begins):
        ends.append(ticks)
    return PedalPhases(np.array(begins, np.int64), np.array(ends, np.int64), most_late)


def _clock_changes(changes: Sequence[int], level: int, plc: int, ticks: int) -> Iterator[int]:
    """Yield the ticks before `ticks` in which pedal-down begins and ends, alternately.

    changes: ticks of packets in which the foot presses and lifts the pedal, alternately. level: run
    level at the start. The rules are those of `state_machine.adopt_level` and `plc.step`, for a
    robot that nothing stops.
    """
    foot, plc_level, mismatches, tick = False, level, 0, 0
    if level == PEDAL_DOWN:  # a count of tick 0 is used in tick 1
        yield 1
    coming = iter([*changes, ticks])
    change = next(coming)
    while tick + 1 < ticks:
        while change <= tick:
            foot, change = not foot, next(coming)
        before = level, plc_level, mismatches
        if plc and plc_level != level:
            mismatches += 1
            if mismatches >= MISMATCHES:
                level, mismatches = plc_level, 0
                yield tick + 1
        plc_level = PEDAL_DOWN if foot else PEDAL_UP
        tick = tick + 1 if (level, plc_level, mismatches) != before else max(tick + 1, change)

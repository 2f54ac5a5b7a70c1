"""Computes before a run when a Raven-II is in pedal-down and when its packets arrive.

The inputs are the operator's motion and the parameters that a campaign varies. The pedal's signal
passes from the foot through a packet to the software, from there to the PLC, and back. None of
these steps depends on a motor, so they are simulated alone, tick by tick around each change of the
foot.

A run may also leave pedal-down because the robot stops, or because the operator reacts and lifts
the foot. After a stop, the PLC stays in its E-stop. After a reaction, only an operator from a
user's file may press the pedal again. The time of this press is not known before the run, but the
pedal can be down only at times when it is down in the planned motion.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ravenjax.engines.interface import TickProgram
from ravenjax.faults.clocks import Clocks, PedalPhases
from ravenjax.numbers import paths, run_eagerly
from ravenjax.robots.raven2.loop.injector import may_restart
from ravenjax.robots.raven2.run_levels import PEDAL_DOWN, PEDAL_UP
from ravenjax.robots.raven2.stages.state_machine import MISMATCHES
from ravenjax.stages import packet_clock
from ravenjax.vocabulary.reactions import SLOW

PEDAL_SITES = ("network", "packet_header")
"""Fault sites where a fault may change the pedal, in addition to those of `may_restart`."""
LATENCY = 8
"""Largest number of ticks from a packet until its pedal changes the run level, with a margin."""
BLOCK_PACKETS = 2**20
"""Largest number of packets whose lengths are drawn at a time, which limits the memory."""


def trigger_clocks(
    program: TickProgram, columns: Sequence[np.ndarray], varied: Mapping[str, np.ndarray], runs: int
) -> Clocks:
    """Return the times of packets and of pedal-down in all runs; see `ravenjax.campaign.prepared`.
    columns: the operator's motion, pedal last. varied: path of a parameter -> its values [runs].
    """
    setup, ticks = program.setup, program.ticks
    numbers = dict(paths.path_leaves(program.params, setup))

    def parameter_values(path: str) -> np.ndarray:
        # Returns the values of a parameter in all runs [runs].
        return np.asarray(varied.get(path, np.full(runs, numbers[path])))

    shortest = np.maximum(parameter_values("network.cycles_per_packet").astype(np.int64), 1)
    longest = shortest
    choice = parameter_values("network.packets").astype(np.int64)
    if setup.packets:
        occurring = [1 + np.flatnonzero(shares) for shares in setup.packets]
        shortest = np.array([lengths[0] for lengths in occurring])[choice]
        longest = np.array([lengths[-1] for lengths in occurring])[choice]
    timeout = parameter_values("control.teleoperation.timeout_ticks")
    obeys_plc = parameter_values("control.state_machine.plc_obeyed") != 0
    slows = "reaction" in setup.stages and parameter_values("reaction.action") == SLOW
    unknown = slows | (longest - 1 > timeout) | (setup.hands is not None)
    # Runs with equal rows of these numbers have the same times of pedal-down
    cases = np.stack([shortest, longest, obeys_plc, unknown], axis=1)
    distinct, case = cases[:1], np.zeros(runs, np.int64)
    if (cases != distinct).any():  # sorting the rows of millions of runs takes seconds
        distinct, case = np.unique(cases, axis=0, return_inverse=True)
    foot = columns[-1].astype(np.int32) > 0
    # In simulator builds, packets end with the software E-stop, at a time that is unknown
    arrivals = None
    if setup.build == "robot" and setup.packets:
        arrivals = DrawnPackets(setup.packets, choice, varied["network.packet_key"], ticks)
    elif setup.build == "robot":
        arrivals = EvenPackets(shortest, ticks)
    phases = []
    for cycles, longest_cycles, plc, unknown_times in distinct.tolist():
        drawn_cycles = longest_cycles if setup.packets else 0
        phases.append(
            _pedal_phases(setup.software, foot, cycles, drawn_cycles, plc, unknown_times, ticks)
        )
    may_move = (key[0] in PEDAL_SITES or may_restart(*key) for key in setup.injection.channels)
    # Code 0 is no channel
    moved = np.array([False, *may_move])
    return Clocks(arrivals=arrivals, phases=tuple(phases), kind=case.reshape(-1), moved=moved)


def planned_pedal_down(
    software: str, foot: np.ndarray, cycles: int, plc: bool, ticks: int
) -> np.ndarray:
    """Return whether the robot is in pedal-down in each tick if nothing stops it, bool [ticks].
    foot: bool [rows of the motion], pedal pressed. cycles: ticks that each packet lasts. plc:
    whether the software obeys the PLC.
    """
    down = np.zeros(ticks, bool)
    phases = _pedal_phases(software, foot, cycles, drawn=0, plc=plc, unknown=False, ticks=ticks)
    for begin, end in zip(phases.begins.tolist(), phases.ends.tolist(), strict=True):
        # The run level begins and ends a tick before the pedal clock, except at the run's end
        level_end = end - 1 if end < ticks else end
        down[begin - 1 : level_end] = True
    return down


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
        # Packet `ticks` + 1 arrives after the end of the run, and so do all later packets
        packets = np.minimum(packets, self.ticks + 1)
        result = np.empty(len(rows), np.int64)
        for indices, first, ticks in self._draw_arrivals(rows, int(packets.max(initial=1))):
            column = packets[indices] - 1 - first
            in_block = (column >= 0) & (column < ticks.shape[1])
            result[indices[in_block]] = ticks[in_block, column[in_block]]
        return result

    def newest(self, rows: np.ndarray) -> np.ndarray:
        count = np.zeros(len(rows), np.int64)
        for indices, _, ticks in self._draw_arrivals(rows, self.ticks + 1):
            count[indices] += (ticks < self.ticks).sum(axis=1)
        return count

    def _draw_arrivals(
        self, rows: np.ndarray, packets: int
    ) -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
        # Yields the arrival ticks of the first `packets` packets of the runs `rows`, in blocks.
        # Each block is (indices in `rows`, index of the first packet, ticks [indices, packets]).
        packets_at_once = min(packets, 4096)
        rows_at_once = max(1, BLOCK_PACKETS // packets_at_once)
        for begin in range(0, len(rows), rows_at_once):
            indices = np.arange(begin, min(begin + rows_at_once, len(rows)))
            arrival = np.zeros(len(indices), np.int64)  # of the first packet of the block
            # `choice` selects the distribution of lengths in `shares`
            key, choice = self.key[rows[indices]][:, None], self.choice[rows[indices]][:, None]
            for first in range(0, packets, packets_at_once):
                end = min(first + packets_at_once, packets)
                packet = np.arange(first, end, dtype=np.int32)[None]
                with run_eagerly():
                    lengths = packet_clock.packet_length(self.shares, choice, key, packet)
                ends = arrival[:, None] + np.cumsum(lengths.astype(np.int64), axis=1)
                yield indices, first, np.concatenate([arrival[:, None], ends[:, :-1]], axis=1)
                arrival = ends[:, -1]


def _pedal_phases(
    software: str, foot: np.ndarray, cycles: int, drawn: int, plc: int, unknown: int, ticks: int
) -> PedalPhases:
    # Returns the intervals of pedal-down in ticks of the run. foot: bool [rows of the motion],
    # pedal pressed. cycles: ticks of each packet, if lengths are not drawn. drawn: ticks of the
    # longest packet, if lengths are drawn, otherwise 0. plc: whether the software obeys the PLC.
    # unknown: whether the intervals depend on what happens in the run.
    changed_rows = np.flatnonzero(np.diff(foot.astype(np.int8), prepend=np.int8(0)))
    # Packet k contains row k of the motion. If lengths are drawn, the motion has a row per tick
    foot_changes = changed_rows * (1 if drawn else cycles)
    foot_changes = foot_changes[foot_changes < ticks]
    # A change of the foot waits for the next packet. None: the times of pedal-down are unknown,
    # also if the effects of two changes may overlap
    max_delay: int | None = max(drawn - 1, 0)
    effects_overlap = max_delay and (np.diff(foot_changes) <= max_delay + LATENCY).any()
    if unknown or effects_overlap:
        max_delay = None
    level = PEDAL_UP if software == "raven2" else PEDAL_DOWN
    clock_changes = list(_pedal_clock_changes(foot_changes.tolist(), level, plc, ticks))
    begins, ends = clock_changes[0::2], clock_changes[1::2]
    if len(ends) < len(begins):  # the run ends in pedal-down
        ends.append(ticks)
    return PedalPhases(np.array(begins, np.int64), np.array(ends, np.int64), max_delay)


def _pedal_clock_changes(
    foot_changes: Sequence[int], level: int, plc: int, ticks: int
) -> Iterator[int]:
    # Yields the ticks before `ticks` in which the pedal clock starts and stops, alternately. It
    # starts one tick after pedal-down begins. foot_changes: ticks of packets in which the foot
    # presses and lifts the pedal, alternately. level: run level of the software and of the PLC at
    # the start. plc: 1 if the software obeys the PLC; 0: its level stays.
    foot, plc_level, mismatches, tick = False, level, 0, 0
    if level == PEDAL_DOWN:
        yield 1
    remaining_changes = iter([*foot_changes, ticks])
    next_change = next(remaining_changes)
    while tick + 1 < ticks:
        while next_change <= tick:
            foot = not foot
            next_change = next(remaining_changes)
        before = level, plc_level, mismatches
        # The software adopts the PLC's level of the last tick after MISMATCHES ticks of difference
        if plc and plc_level != level:
            mismatches += 1
            if mismatches >= MISMATCHES:
                level, mismatches = plc_level, 0
                yield tick + 1
        plc_level = PEDAL_DOWN if foot else PEDAL_UP
        # If this tick changed nothing, nothing changes until the foot does, so skip these ticks
        changed = (level, plc_level, mismatches) != before
        tick = tick + 1 if changed else max(tick + 1, next_change)

"""The simulated robots of a session: the driven one with its golden run, and the virtual one."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.engines.cpu.stepper import Stepper
from ravenjax.faults.fault import FaultSlot
from ravenjax.numbers import tree
from ravenjax.numbers.vec import replace
from ravenjax.stages import monitor
from ravenjax.train.protocol import GOLDEN, Frame, FrameLayout, Json
from ravenjax.train.robot import E_STOP, Packet
from ravenjax.train.session import blueprint
from ravenjax.train.session.blueprint import Blueprint
from ravenjax.vocabulary.effects import TRIGGER_CODES

_FIELDS = tuple(field.name for field in dataclasses.fields(FaultSlot))
HISTORY_MS = 2000
"""How far back a packet may be sent again. A copied robot takes over this many rows of motion."""


class SimulatedRobot:
    """A robot and its golden run. `row` holds its channels after each `step`.

    While no fault is armed the two are identical, and only one is computed.
    """

    def __init__(self, blueprint: Blueprint) -> None:
        self.blueprint = blueprint
        code = blueprint.code
        self._own = Stepper(code, blueprint.inputs)
        self._beside = Stepper(code, blueprint.inputs, self._own.flat)
        self._shown = np.zeros((2, code.outputs), np.float32)
        self._addresses = [self._shown.ctypes.data + i * self._shown.strides[0] for i in (0, 1)]
        self.row = self._shown[0, : blueprint.layout.simulated]
        # [columns, ticks], filled row by row.
        self.motion = self._own.flat.reshape(len(code.tables), -1)
        first, last = (blueprint.layout.places[name] for name in (GOLDEN[0], GOLDEN[-1]))
        # Channels of the golden run in the row.
        self._golden = self._shown[:, first.start : last.stop]
        self.now = 0  # the next tick
        self._series = self._shown[1, blueprint.layout.simulated :]
        series = self._series.size
        self._reference = self._own.entering[:series]
        self._apart = False
        self._told_apart = self._own.entering[series]
        self.packets = [stepper.entering[series + 1 :] for stepper in (self._own, self._beside)]
        """Where a packet from outside enters the robot and its golden run."""
        self._fresh = self._own.snapshot()
        places = tree.fill_tree(code.state.record, list(range(len(code.state.layout.types))))
        # Leaves of each slot in the state.
        self._slots = [tree.tree_leaves(slot) for slot in places.faults.slots]
        self._fault_inputs = len(code.inputs.layout.types) - len(_FIELDS) * (
            blueprint.fault_slots + 1
        )

    def step(self) -> None:
        """Advance by one tick."""
        if self._apart:
            self._beside.step(self.now, self._addresses[1])
            for place, number in zip(self._reference, self._series.tolist(), strict=True):
                place[0] = number
        self._own.step(self.now, self._addresses[0])
        if self._apart:
            self._golden[0] = self._golden[1]
        self.now += 1

    def outcomes(self) -> Json:
        """Return the robot's outcomes so far: outcome columns of a campaign."""
        return self._own.outcomes()

    def golden_outcomes(self) -> Json:
        """Return the outcomes of the golden run, which lacks the fault that was armed last."""
        return self._beside.outcomes() if self._apart else self._own.outcomes()

    heard = True
    """Whether reports of the robot arrive: always for a simulated robot."""

    def stand_by(self) -> None:
        """Restart the waiting robot's motion table; its position is the same."""
        self.reset()

    def reset(self) -> None:
        """Return to the start: homed, at rest, pedal up, no fault armed."""
        self.disarm()
        for robot in (self._own, self._beside):
            robot.begin()
        self.now = 0

    def copy_from(self, other: SimulatedRobot) -> None:
        """Take over the state of another robot of the same blueprint, without its faults."""
        self.disarm()
        for mine, theirs in ((self._own, other._own), (self._beside, other._beside)):
            mine.restore(theirs.snapshot())
        self._part(other._apart)
        begin = max(0, other.now - HISTORY_MS)
        self.motion[:, begin : other.now] = other.motion[:, begin : other.now]
        self._shown[:] = other._shown
        self.now = other.now

    def _realign(self) -> None:
        """Start the golden run again at the robot's state: a past hazard has left the two apart."""
        self._own.change(
            lambda state: replace(state, monitor=monitor.realign_golden(state.monitor))
        )
        self._beside.restore(self._own.snapshot())

    def _part(self, apart: bool) -> None:
        self._apart = apart
        self._told_apart[0] = -int(apart)

    # --- faults ---

    def arm(self, row: int) -> None:
        """Activate the faults of this row of the fault table from the next tick on.

        They keep their distances in time, and none waits for the pedal.
        """
        faults = self.blueprint.plan.faults
        slots = range(self.blueprint.fault_slots)
        used = [slot for slot in slots if faults["code"][row, slot]]
        first = min((int(faults["start"][row, slot]) for slot in used), default=0)
        for slot in slots:
            values = {name: column[row, slot] for name, column in faults.items()}
            packets = values["trigger"] == TRIGGER_CODES["packet"]  # packet numbers start at 1
            values["trigger"] = TRIGGER_CODES["packet" if packets else "time"]
            values["start"] = self.now + packets + int(values["start"]) - first
            self._write(slot, values if slot in used else None)
        for k, values in enumerate(self.blueprint.plan.varied.values()):
            self._own.inputs[k][0] = values[row]
        self._forget(slots)
        self._realign()
        self._part(True)

    def disarm(self) -> None:
        """Remove the faults that `arm` and `press` set."""
        slots = range(self.blueprint.fault_slots + 1)
        for slot in slots:
            self._write(slot, None)
        for k, value in enumerate(self.blueprint.inputs[0]):
            self._own.inputs[k][0] = value
        self._forget(slots)
        self._realign()
        self._part(False)

    def press(self, row: int, ticks: int = 100) -> None:
        """Hold the button of this row of the fault table for this number of ticks."""
        if not self._apart:
            self._beside.restore(self._own.snapshot())
            self._part(True)
        values = {name: column[row, 0] for name, column in self.blueprint.plan.faults.items()}
        slot = self.blueprint.fault_slots
        self._write(
            slot, values | {"trigger": TRIGGER_CODES["time"], "start": self.now, "duration": ticks}
        )
        self._forget([slot])

    def _write(self, slot: int, values: Json | None) -> None:
        first = self._fault_inputs + slot * len(_FIELDS)
        for k, name in enumerate(_FIELDS):
            self._own.inputs[first + k][0] = (name == "period") if values is None else values[name]

    def _forget(self, slots: Sequence[int] | range) -> None:
        self._own.restore_leaves(
            self._fresh, [leaf for slot in slots for leaf in self._slots[slot]]
        )


class EstopHold:
    """Freezes the nominal model of a stopped robot in its rows.

    The model in the tick follows the console's clean packets. A foot that stays on the pedal of a
    stopped robot would move it on: hundreds of millimetres away, with the cue at its cap. So the
    model is held from the first tick of an E-stop, the robot's or its software's, until the robot
    restarts. The error is then the measured tip's distance from the held model. The force is zero,
    because a hand cannot move a robot that holds its brakes. This applies to what is shown, felt
    and recorded. The tick itself stays the campaigns', bit for bit.
    """

    def __init__(self, layout: FrameLayout) -> None:
        places = layout.places
        self._runlevel, self._software = places["runlevel"].start, places["soft_estopped"].start
        self._arms = [
            tuple(
                places[f"{arm}/{name}"] for name in ("model_tip", "position", "error_mm", "force")
            )
            for arm in layout.arms
        ]
        names = ("model_jpos", "model_tip")
        held = [places[f"{arm}/{name}"] for arm in layout.arms for name in names]
        self._model = np.r_[*held]
        # Pose of the models when the robot stopped; None: the robot is not stopped.
        self._pose: np.ndarray | None = None

    def apply(self, row: np.ndarray) -> None:
        """Change this tick's row, float32, in place."""
        if row[self._runlevel] != E_STOP and not row[self._software]:
            self._pose = None
            return
        if self._pose is None:
            self._pose = row[self._model]
        row[self._model] = self._pose
        for tip, position, error, force in self._arms:
            row[error] = 1e3 * np.linalg.norm(row[position] - row[tip])
            row[force] = 0.0


class PacketRobot(SimulatedRobot):
    """A robot that gets its packets from outside: call `tick(packet)` once a millisecond."""

    def __init__(self, config: CampaignConfig) -> None:
        """Raises UserError if a hazard of `config` is on the console's side of the network."""
        super().__init__(blueprint.make_blueprint(config, packets=True))
        self.arms = self.blueprint.setup.arms
        self.frame = Frame(self.blueprint.layout)
        self._estop_hold = EstopHold(self.blueprint.layout)

    def tick(self, packet: Packet | None) -> Frame:
        """Advance by one tick with a packet or None. Returns the same frame each time."""
        if packet is not None:
            leaves = tree.tree_leaves(packet)
            for entering in self.packets:
                for place, number in zip(entering, leaves, strict=True):
                    place[0] = number
        else:
            for entering in self.packets:
                entering[0][0] = 0  # received
        self.step()
        self.frame.row[: self.row.size] = self.row
        self._estop_hold.apply(self.frame.row)
        return self.frame

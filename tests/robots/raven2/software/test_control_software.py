"""The package's control software against a second, imperative writing of the original, tick for
tick.
"""

import copy
import dataclasses
import random

import numpy as np
import oracle_control_software as oracle
import pytest
import rig_control_software as rig
from closed_loop import decode

from ravenjax.errors import UserError
from ravenjax.numbers.setup import CAMPAIGN
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.software.control_software import ControlSoftware

ARMS = {"gold": oracle.GOLD, "green": oracle.GREEN}
FLOATS = ("mpos", "mvel", "jpos", "jpos_d", "mpos_d", "tau_d")


class Pair:
    """Both programs and the rig around them."""

    def __init__(
        self,
        seed,
        software="raven2",
        arms=("gold", "green"),
        tool=None,
        policy="soft_regulation",
        level=None,
        plc=True,
        bad=True,
        calm=False,
        wrist_rad=0.0,
    ):
        tool = tool or ("r_grasper" if software == "raven2" else "r_grasper_B")
        self.rng, self.calm = random.Random(seed), calm
        self.options = (software, arms, (tool,) * len(arms), policy, level)
        self.plc_obeyed, self.start = plc, 0 if plc else 3
        self.new = self.program()
        number = ("no_regulation", "soft_regulation", "hard_regulation").index(policy)
        fork, limits = software == "fork2015", level or "moderate"
        self.old = oracle.Loop(
            [ARMS[a] for a in arms], self.options[2], fork, number, limits, plc, self.start
        )
        self.wrist_rad = wrist_rad
        self.motors = [self.at_home(mech) for mech in self.old.mech]
        for mech in self.old.mech:
            mech.joint[oracle.ZI].mpos = np.float32(0)
            self.old.inverse_coupling(mech)
            mech.joint[oracle.ZI].mpos = mech.joint[oracle.ZI].mpos_d
            self.old.inverse_coupling(mech)
        self.console, self.plc = rig.Console(self.rng, bad), rig.Plc(self.rng, len(arms))
        self.tick = 0

    def program(self, **changed):
        def obey(params):
            machine = dataclasses.replace(
                params.state_machine, plc_obeyed=np.int32(self.plc_obeyed)
            )
            return dataclasses.replace(params, state_machine=machine)

        return ControlSoftware(*self.options, runlevel=self.start, params=obey, **changed)

    def at_home(self, mech):
        """Motors at the home pose, but for the wrist where told."""
        mech = copy.deepcopy(mech)
        mech.joint[oracle.WR].jpos_d = np.float32(self.wrist_rad)
        # Positioning joints; the tool motors follow the insertion motor.
        self.old.inverse_coupling(mech)
        mech.joint[oracle.ZI].mpos = mech.joint[oracle.ZI].mpos_d
        self.old.inverse_coupling(mech)
        joints = [mech.joint[k] for k in oracle.USED]
        return rig.Motors(
            [float(j.mpos_d) for j in joints],
            [j.enc_sign for j in joints],
            [j.tau_sign for j in joints],
        )

    def inputs(self):
        """Encoders, datagrams, pins and read flags of one cycle."""
        rng = self.rng
        noise = rng.random() < 0.5
        enc = [motor.counts(rng, noise) for motor in self.motors]
        if not self.calm and rng.random() < 0.001:
            enc[0][rng.randrange(7)] += rng.choice((30, -200, 3000, -40000))
        if not self.calm and rng.random() < 0.0003:  # the motor itself jumps, and stays there
            self.motors[-1].angle[rng.randrange(7)] += rng.choice((0.5, -20.0))
        return enc, self.console.arrivals(), self.plc.pins(), [rng.random() > 0.005 for _ in enc]

    def step(self):
        enc, arrivals, pins, read_ok = self.inputs()
        for data in arrivals:
            self.old.network(data)
        dac, byte = self.old.cycle(enc, pins, read_ok)
        output = self.new.step(enc, arrivals, pins, read_ok)
        for motor, command in zip(self.motors, dac, strict=True):
            motor.step(command)
        self.tick += 1
        return dac, byte, output

    def compare(self, ticks):
        """Run both: every number must be equal. Returns what the run went through."""
        seen = {"levels": set(), "stops": 0, "clamped": 0, "saturated": 0}
        for _ in range(ticks):
            stopped = self.old.soft_estopped
            dac, byte, output = self.step()
            self.assert_equal(dac, byte, output)
            signals = output.signals
            seen["levels"].add((self.old.runlevel, self.old.sublevel))
            seen["stops"] += self.old.soft_estopped and not stopped
            seen["clamped"] += signals.clamped
            seen["saturated"] += any(
                abs(c) == 32767 or c == -32768 for arm in signals.arms for c in arm.current_cmd
            )
        return seen

    def assert_equal(self, dac, byte, output):
        old, signals, where = (
            self.old,
            output.signals,
            f"tick {self.tick}, level {self.old.runlevel}",
        )
        assert [list(arm) for arm in output.dac] == dac, where
        assert output.output_pins == byte, where
        assert (signals.runlevel, signals.sublevel) == (old.runlevel, old.sublevel), where
        assert (signals.surgeon_mode, signals.last_seq % 2**32) == (
            old.surgeon_mode,
            old.last_sequence,
        ), where
        for mech, arm in zip(old.mech, signals.arms, strict=True):
            assert list(arm.pos.position_um) == list(mech.pos), where
            assert list(arm.pos_d.position_um) == list(mech.pos_d), where
            assert (arm.pos.grasp_mrad, arm.pos_d.grasp_mrad) == (mech.grasp, mech.grasp_d), where
            assert_rotations_equal(arm.pos.rotation, mech.R, where)
            assert_rotations_equal(arm.pos_d.rotation, mech.R_d, where)
            for name in FLOATS if old.fork else (*FLOATS, "tau_g"):
                for k, value in zip(
                    oracle.USED, getattr(arm, name), strict=False
                ):  # tau_g: three of them
                    expected = getattr(mech.joint[k], name)
                    assert value == expected, (
                        f"{where}: {name}[{k}] {value!r}, expected {expected!r}"
                    )


def assert_rotations_equal(rows, expected, where):
    """Number for number; all-zero quaternions make NaN of both."""
    assert np.array_equal(
        np.array(rows, np.float32), np.array(expected, np.float32), equal_nan=True
    ), where


RUNS = {
    "raven2": {"seed": 1},
    "fork2015": {"seed": 2, "software": "fork2015"},
    "fork2015 without PLC": {"seed": 3, "software": "fork2015", "plc": False},
    "hard policy": {"seed": 4, "policy": "hard_regulation"},
    "no policy": {"seed": 5, "policy": "no_regulation", "level": "beginner"},
    "coupled wrist": {"seed": 6, "tool": "large_needle"},
    "green alone": {"seed": 7, "arms": ("green",)},
    "square tools, good network": {"seed": 8, "tool": "r_sq_grasper", "bad": False},
}


@pytest.mark.parametrize(
    "run", [run if run == "raven2" else pytest.param(run, marks=pytest.mark.slow) for run in RUNS]
)
def test_every_number_equals_the_original_order_of_statements(run):
    seen = Pair(**RUNS[run]).compare(1200)
    if run == "raven2":
        assert {level for level, _ in seen["levels"]} == {0, 1, 2, 3}
        assert seen["stops"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("run", ["fork2015", "coupled wrist"])
def test_long_runs_equal_the_original_order_of_statements(run):
    seen = Pair(**RUNS[run]).compare(10_000)
    assert seen["clamped"] > 0 and seen["stops"] > 0


@pytest.mark.slow
def test_float32_campaigns_stay_near_exact_arithmetic():
    """DACs of both under the same encoders; a straight wrist would leave the roll to rounding."""
    pair, gaps = Pair(11, bad=False, calm=True, wrist_rad=0.2), []
    other = pair.program(precision=CAMPAIGN)
    for _ in range(2000):
        inputs = pair.inputs()
        exact, campaign = pair.new.step(*inputs), other.step(*inputs)
        for motor, dac in zip(pair.motors, exact.dac, strict=True):
            motor.step(dac)
        gaps.append(np.abs(np.subtract(exact.dac, campaign.dac)).max())
    assert np.count_nonzero(gaps) < 0.2 * len(gaps) and max(gaps) < 10


def _counts(arms=2):
    return [[0] * 7] * arms


def test_bytes_and_packet_are_the_same():
    data = rig.datagram(1, [[10, 20, 30], [-1, -2, -3]], [[0, 0, 0.1, 1]] * 2, (5, 6), 1)
    one, two = ControlSoftware(), ControlSoftware()
    one.step(_counts(), data)
    two.step(_counts(), decode(data, ("gold", "green")))
    assert one.state == two.state


@pytest.mark.slow
def test_absolute_poses_replace_the_accumulator():
    software = ControlSoftware("fork2015", console="absolute")
    pose = Packet(1, 204, 1, ((1, 2, 3), (4, 5, 6)), ((0, 0, 0, 1), (0, 1, 0, 0)), (100, 200), 1)
    software.step(_counts(), pose)
    gold, green = (arm.pose for arm in software.state.teleoperation.arms)
    assert (tuple(gold.position_um), gold.grasp_mrad) == ((1, 2, 3), 100)
    assert [list(row) for row in green.rotation] == [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]


POSE = Packet(1, 124, 1, ((0, 0, 0),) * 2, ((0, 0, 0, 1),) * 2, (0, 0), 1)


def refused(call, words):
    with pytest.raises(UserError) as error:
        call()
    for word in words:
        assert word in str(error.value), str(error.value)


SETUPS = [
    ({"software": "raven3"}, ("software is 'raven3'", "raven2")),
    ({"arms": "gold"}, ("arms is 'gold'", "arms=['gold']")),
    ({"tools": ("r_grasper",)}, ("tools has 1 entries", "one tool per arm ['gold', 'green']")),
    ({"tools": ("r_graspr", "r_grasper")}, ("'r_graspr'", "Did you mean 'r_grasper'")),
    ({"enc_offset": float("nan")}, ("enc_offset is nan", "integers")),
    ({"runlevel": 9}, ("runlevel is 9", "0..3")),
    ({"params": lambda params: None}, ("params returned None",)),
]


@pytest.mark.parametrize(("given", "words"), SETUPS, ids=[words[0] for _, words in SETUPS])
def test_a_wrong_setup_is_named(given, words):
    refused(lambda: ControlSoftware(**given), words)


def one_gain(value):
    def change(params):
        first = params.motor_control[0]
        changed = dataclasses.replace(first, kp=first.kp.replace(0, value))
        return dataclasses.replace(params, motor_control=(changed, *params.motor_control[1:]))

    return change


def test_changed_parameters_are_numbers_of_their_own_type():
    """Plain Python numbers will do; no numbers will not."""
    software = ControlSoftware(params=one_gain(0.5))
    assert (
        software.step(_counts()).dac
        == ControlSoftware(params=one_gain(np.float32(0.5))).step(_counts()).dac
    )
    for value, got in ((float("nan"), "nan"), ("0.5", "'0.5'")):
        refused(
            lambda v=value: ControlSoftware(params=one_gain(v)),
            ("params.motor_control[0].kp[0]", got, "finite"),
        )


def changed(**fields):
    return {"packet": dataclasses.replace(POSE, **fields)}


INPUTS = [
    ({"encoders": [[0] * 7, [0] * 6]}, ("encoders is [[0, 0", "[2, 7]")),
    ({"encoders": [[0.5] * 7] * 2}, ("encoders", "float64", "integers")),
    (
        {"encoders": [[0] * 6 + [2**31], [0] * 7]},
        ("encoders[0][6] (grasp2) is 2147483648", "32-bit"),
    ),
    ({"pins": 256}, ("pins is 256", "0..255")),
    ({"read_ok": 5}, ("read_ok is 5", "0..1")),
    ({"packet": "packet"}, ("packet is str", "bytes")),
    (changed(delta=((0.5, 0, 0), (0, 0, 0))), ("packet.delta[0][0] is 0.5", "whole number")),
    (changed(quat=((0, 0, 0, 1), ("a", 0, 0, 1))), ("packet.quat[1][0] is 'a'", "number")),
    (changed(sequence=2**32), ("packet.sequence is 4294967296",)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("given", "words"), INPUTS, ids=[words[0] for _, words in INPUTS])
def test_a_wrong_input_is_named_and_nothing_has_happened(given, words):
    software, other = ControlSoftware(), ControlSoftware()
    refused(lambda: software.step(**{"encoders": _counts(), **given}), words)
    assert software.state == other.state
    assert software.step(_counts()).dac == other.step(_counts()).dac


def test_whatever_a_network_brings_is_taken():
    """Bytes of any length and quaternions of any numbers are the software's to judge."""
    software = ControlSoftware()
    for datagram in (b"", b"abc", bytes(70_000), memoryview(bytes(124)), b"\xff" * 124):
        software.step(_counts(), datagram)
    assert software.state.network.size.count == 2
    wild = dataclasses.replace(
        POSE, sequence=2**32 - 1, quat=((float("nan"),) * 4, (float("inf"), 0, 0, 1))
    )
    again = dataclasses.replace(wild, sequence=-1)
    one, two = ControlSoftware(), ControlSoftware()
    assert one.step(_counts(), wild).dac == two.step(_counts(), again).dac
    assert one.state.network.last == two.state.network.last == -1

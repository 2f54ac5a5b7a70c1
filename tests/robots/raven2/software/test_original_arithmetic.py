"""The arithmetic and the corner cases of the original control software, one test each.

The comparison with a second writing, tick for tick (`test_control_software`), covers many more.
"""

import math
import random

import jax
import numpy as np
import oracle_control_software as oracle
import pytest
import rig_control_software as rig
from numpy import float32

from ravenjax.numbers.setup import ORIGINAL
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software.control_software import ControlSoftware
from ravenjax.robots.raven2.stages import cartesian_control, estimator

SETUP = RavenSetup(arms=("gold", "green"), tools=("large_needle",) * 2, precision=ORIGINAL)
STILL, UNIT = ([0.0] * 3,) * 2, ([0.0, 0.0, 0.0, 1.0],) * 2
HOME = (30 * oracle.DEG, 90 * oracle.DEG, 0.4, 0.0, 0.2, 45 * oracle.DEG, 45 * oracle.DEG)


class Bench:
    """The control software of both arms with motors that stand where they are put."""

    def __init__(self, joints=(HOME, HOME), **options):
        self.software = ControlSoftware(**options)
        self.mechs = [
            oracle.Mechanism(arm, "r_grasper", False) for arm in (oracle.GOLD, oracle.GREEN)
        ]
        self.joints = [list(arm) for arm in joints]
        self.sequence = 0
        self.extra = np.zeros((2, 7), int)

    def encoders(self):
        return (
            np.array([self.counts(m, js) for m, js in zip(self.mechs, self.joints, strict=True)])
            + self.extra
        )

    @staticmethod
    def counts(mech, joints):
        for k, value in zip(oracle.USED, joints, strict=True):
            mech.joint[k].jpos_d = float32(value)
        for _ in range(2):
            oracle.Loop.inverse_coupling(None, mech)
            mech.joint[oracle.ZI].mpos = mech.joint[oracle.ZI].mpos_d
        scale = rig.COUNTS_PER_RAD
        return [
            round(mech.joint[k].enc_sign * float(mech.joint[k].mpos_d) * scale) for k in oracle.USED
        ]

    def step(self, level, packets=None, **options):
        return self.software.step(self.encoders(), packets, level << 6, **options)

    def packet(self, moves=STILL, quats=UNIT, grasp=(0, 0), mode=1, extra=0):
        self.sequence += 1
        return rig.datagram(self.sequence, moves, quats, grasp, mode) + bytes(extra)

    def run(self, level, ticks, **options):
        for _ in range(ticks):
            output = self.step(level, **options)
        return output

    def pedal_down(self):
        """Through initialisation and pedal-up into pedal-down."""
        self.run(1, 30)
        self.run(2, 10)
        return self.run(3, 10)


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def numbers(vec):
    return [float(x) for x in vec]


def test_motor_angle_is_rounded_once_from_a_double_product_with_float32_pi():
    rng = random.Random(1)
    params, state = estimator.params(), estimator.init(SETUP)
    counts = [rng.randrange(-700_000, 700_000) for _ in range(7)]
    _, mpos, _ = estimator.step(
        SETUP, "gold", "r_grasper", params, state, Vec(map(np.int32, counts))
    )
    signs = (-1, -1, -1, -1, -1, 1, -1)
    expected = [
        float32(2.0 * 3.1415927410125732 * (1 / 4000) * (s * c))
        for s, c in zip(signs, counts, strict=True)
    ]
    assert numbers(mpos) == [float(x) for x in expected]
    with_pi = [
        float32(2.0 * math.pi * (1 / 4000) * (s * c)) for s, c in zip(signs, counts, strict=True)
    ]
    assert numbers(mpos) != [float(x) for x in with_pi]


def test_velocity_is_a_float32_difference_over_float32_of_one_millisecond():
    params, state = estimator.params(), estimator.init(SETUP)
    state, first, still = estimator.step(
        SETUP, "gold", "r_grasper", params, state, Vec.full(7, np.int32(-573_001))
    )
    assert numbers(still) == [0.0] * 7
    differs = 0
    for jump in range(1, 40):
        later = Vec.full(7, np.int32(-573_001 - jump))
        _, second, moving = estimator.step(SETUP, "gold", "r_grasper", params, state, later)
        expected = (float32(second[2]) - float32(first[2])) / float32(0.001)
        assert float(moving[2]) == float(expected)
        differs += float(expected) != float(float32((float(second[2]) - float(first[2])) / 0.001))
    assert differs > 0


def test_poses_are_cut_to_micrometres_and_opening_to_milliradians_in_float32():
    jpos = Vec(
        map(
            float32,
            (15 * oracle.DEG, 60 * oracle.DEG, 0.30, -40 * oracle.DEG, 20 * oracle.DEG, 0.3, 0.7),
        )
    )
    pose = cartesian_control.measure_pose(SETUP, "gold", jpos)
    assert [int(x) for x in pose.position_um] == [-176273, 21667, -40995]
    sums = [
        (float32(a / 1000), float32(b / 1000)) for a in range(0, 900, 7) for b in range(0, 900, 7)
    ]
    cut = [int(float32((a + b) * float32(1000))) for a, b in sums]
    in_double = [int((float(a) + float(b)) * 1000) for a, b in sums]
    place = next(i for i in range(len(sums)) if cut[i] != in_double[i])
    pose = cartesian_control.measure_pose(
        SETUP, "gold", jpos.replace(5, sums[place][0]).replace(6, sums[place][1])
    )
    assert int(pose.grasp_mrad) == cut[place]


def test_joint_limits_are_float32_values_and_include_equality():
    bench = Bench(joints=((30 * oracle.DEG, 46 * oracle.DEG, *HOME[2:]), HOME))
    bench.pedal_down()
    # In pedal-up the wanted pose follows the measured one, and is clamped.
    bench.joints[0][1] = 43 * oracle.DEG
    output = bench.run(2, 20)
    assert output.signals.clamped
    assert float(output.signals.arms[0].jpos_d[1]) == 0.7853981852531433


def test_opening_is_only_reset_when_it_is_more_than_45_degrees_off():
    bench = Bench()
    bench.pedal_down()
    bench.step(3, bench.packet(grasp=(700, 800)))
    bench.run(2, 6)
    gold, green = (arm.pose.grasp_mrad for arm in bench.software.state.teleoperation.arms)
    measured = bench.step(2).signals.arms[0].pos.grasp_mrad
    assert (gold, green) == (measured - 700, measured)


def test_a_clamp_of_one_arm_re_anchors_both_from_their_wanted_poses():
    bench = Bench(joints=((*HOME[:2], 0.2305, *HOME[3:]), HOME))
    bench.pedal_down()
    moves = ([91.0, 48.0, 282.0], [100.0, 0.0, 0.0])  # gold: outward along the insertion axis
    for _ in range(20):
        output = bench.step(3, bench.packet(moves, ([0.0, 0.0, 0.01, 1.0],) * 2))
        if output.signals.clamped:
            break
    assert output.signals.clamped
    green, origin = output.signals.arms[1].pos_d, bench.software.state.teleoperation.arms[1]
    assert origin.pose.position_um == green.position_um
    rebuilt = oracle.quaternion_of([[float(e) for e in row] for row in green.rotation])
    assert [float(q) for q in origin.quaternion] == rebuilt
    assert bench.software.state.teleoperation.updated


def test_sublevels_take_1_1_11_cycles_and_then_set_ready():
    bench = Bench()
    shown = [
        (o.signals.sublevel, o.signals.initialized) for o in (bench.step(1) for _ in range(18))
    ]
    assert shown == [(0, 0)] * 3 + [(1, 0)] + [(2, 0)] * 11 + [(3, 0)] + [(3, 1)] * 2


def test_crossing_half_a_turn_of_roll_saturates_the_dac_and_stops():
    joints = (*HOME[:3], 179.9 * oracle.DEG, *HOME[4:])
    bench = Bench(joints=(joints, HOME))
    bench.pedal_down()
    bench.joints[0][3] = 180.5 * oracle.DEG
    output = bench.step(3)
    assert abs(output.signals.arms[0].current_cmd[3]) >= 32767
    assert output.signals.overdrive
    assert output.dac[0][3] == 0


def test_integrals_run_on_in_pedal_down_while_soft_e_stopped():
    bench = Bench()
    bench.pedal_down()
    bench.extra[0, 0] += 50_000
    assert bench.step(3).signals.overdrive
    before = bench.software.state.motor_control[0]
    output = bench.step(3)
    after = bench.software.state.motor_control[0]
    assert output.dac == ((0,) * 7,) * 2
    assert after.integral[3] != before.integral[3]
    assert any(after.tau_d)


def test_a_rejected_arm_holds_its_joints_and_freezes_those_after_it():
    bench = Bench()
    held = bench.pedal_down().signals
    output = bench.step(3, bench.packet(([0.0, 100_000.0, 0.0], [500.0, 0.0, 0.0])))  # 100 mm
    assert bench.software.state.cartesian[0].ik_reject.count == 1
    assert [arm.jpos_d for arm in output.signals.arms] == [arm.jpos_d for arm in held.arms]
    assert output.signals.arms[1].pos_d.position_um != held.arms[1].pos_d.position_um


# --- 14 ---


def test_the_watchdog_is_silent_in_the_cycle_of_the_trip_and_restarts_after_one_low_cycle():
    bench = Bench()
    bench.pedal_down()
    while bench.software.state.watchdog != 5:
        bench.step(3)
    assert bench.step(3).output_pins & 16
    bench.extra[0, 0] += 50_000
    output = bench.step(3)
    assert output.signals.overdrive
    assert not output.output_pins & 16
    for _ in range(60):
        assert not bench.step(3).output_pins & 16
    bench.run(0, 3)
    assert bench.software.state.watchdog > 50
    high = [bool(bench.step(0).output_pins & 16) for _ in range(4)]
    assert high == [False, True, True, True]

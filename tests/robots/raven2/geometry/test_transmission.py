import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_kinematics import RECORDED

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.geometry.tools import TOOLS
from ravenjax.robots.raven2.geometry.transmission import (
    coupling_signs,
    encoder_signs,
    joint_from_motor,
    motor_from_joint,
    tau_signs,
)

DEG = np.pi / 180

# deg, of the motors in the stored state of `test_kinematics`, 8 slots.
MOTORS = {
    "gold": (
        "4078.98022461 11511.7197266 51634.2617188 0 17779.2304688 17789.4902344 -17360.9101562"
        " 18211.6816406"
    ),
    "green": (
        "4075.19995117 11512.6210938 51559.1992188 0 -17749.3496094 -17754.390625 18157.5898438"
        " -17343.2714844"
    ),
}


def seven(text: str) -> np.ndarray:
    return np.delete(np.array(text.split(), float), 3) * DEG


def test_ratios():
    expected = (
        136.19625550660794,
        121.52207496453373,
        2158.590308370044,
        5.395176252319110,
        8.991960420531850,
    )
    np.testing.assert_allclose(
        transmission.TR, (*expected, 8.991960420531850, 8.991960420531850), rtol=1e-14
    )
    assert pytest.approx(2.9087004405286345, rel=1e-15) == transmission.GB_RATIO
    counts = [3695.806680881308] * 3 + [27328.42436374035] * 4
    np.testing.assert_allclose(transmission.COUNTS_PER_NM, counts, rtol=1e-14)
    per_count = np.array(transmission.JOINT_PER_CAPSTAN_TORQUE) / transmission.COUNTS_PER_NM
    np.testing.assert_allclose(per_count[:3], [3.00829e-3, 2.68417e-3, 4.76788e-2], rtol=2e-6)
    resolution = transmission.ENCODER_RAD / np.array(transmission.TR)
    np.testing.assert_allclose(
        resolution[[0, 1, 3, 4]] / DEG, [6.60811e-4, 7.40606e-4, 0.0166816, 0.0100089], rtol=5e-6
    )
    assert resolution[2] * 1e6 == pytest.approx(0.727695, rel=1e-6)


@pytest.mark.parametrize("arm", ARMS)
def test_recorded_robot(arm):
    jpos, mpos = seven(RECORDED[arm][2]), seven(MOTORS[arm])
    np.testing.assert_allclose(
        np.array(joint_from_motor(arm, "r_grasper", Vec(mpos))) / DEG, jpos / DEG, atol=1.6e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize("software", ["raven2", "fork2015"])
@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("arm", ARMS)
@given(jpos=st.lists(st.floats(-3, 3), min_size=7, max_size=7))
def test_both_ways(arm, tool, software, jpos):
    mpos = motor_from_joint(arm, tool, Vec(jpos), software=software)
    np.testing.assert_allclose(
        mpos, np.array(transmission.motor_matrix(arm, tool, software)) @ jpos, atol=1e-9
    )
    np.testing.assert_allclose(joint_from_motor(arm, tool, mpos, software), jpos, atol=1e-11)


def test_tool_motors_follow_the_measured_insertion_motor():
    near = motor_from_joint("gold", "r_grasper", HOME_JPOS, 900.0)
    own = motor_from_joint("gold", "r_grasper", HOME_JPOS)
    share = (900.0 - own[2]) / transmission.GB_RATIO
    np.testing.assert_allclose(
        np.array(near) - own, [0, 0, 0, share, share, -share, share], atol=1e-12
    )


SIGNS = [  # arm, tool, software, coupling of the tool motors, torque, encoder
    ("gold", "r_grasper", "raven2", "++-+", "-----+-", "-----+-"),
    ("green", "r_grasper", "raven2", "--+-", "+++--+-", "+++--+-"),
    ("gold", "large_needle", "raven2", "--+-", "---++-+", "---++-+"),
    ("green", "large_needle", "raven2", "++-+", "+++++-+", "+++++-+"),
    ("gold", "r_sq_grasper", "raven2", "--+-", "-----+-", "---++-+"),
    ("green", "r_sq_grasper", "raven2", "--+-", "+++++-+", "+++--+-"),
    ("gold", "r_grasper_B", "fork2015", "++++", "-------", "-------"),
    ("green", "r_grasper_A", "fork2015", "----", "+++----", "+++----"),
]


@pytest.mark.parametrize(("arm", "tool", "software", "coupling", "torque", "encoder"), SIGNS)
def test_signs(arm, tool, software, coupling, torque, encoder):
    for got, expected in (
        (coupling_signs(arm, tool, software), coupling),
        (tau_signs(arm, tool, software), torque),
        (encoder_signs(arm, tool, software), encoder),
    ):
        assert "".join("+" if sign > 0 else "-" for sign in got) == expected

import dataclasses

import numpy as np
import oracle_kinematics as oracle
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ravenjax.numbers.lazy import run_eagerly
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.joints import Pose, wrap_angle

DEG = np.pi / 180


def joints(sh, el, z, roll, wrist, g1, g2) -> np.ndarray:
    return np.array([sh * DEG, el * DEG, z, roll * DEG, wrist * DEG, g1 * DEG, g2 * DEG])


HOME = joints(30, 90, 0.4, 0, 0, 45, 45)
A = joints(15, 60, 0.30, -40, 20, 30, 50)

# A stored state of a real Raven-II: position um, rotation, joints deg (8 slots, insertion in m too
# times 180/pi).
RECORDED = {
    "gold": (
        (-77452, -24161, 13793),
        (
            "-.968002378941 -.174213960767 .180612385273 -.219871729612 .241933107376"
            " -.945052802563 .120945267379 -.954524934292 -.272496551275"
        ),
        (
            "29.9492835999 90.373336792 22.9568557739 0 5.11032962799 4.20706319809 43.4555168152"
            " 51.1591072083"
        ),
    ),
    "green": (
        (-77623, 25864, 13439),
        (
            "-.93315243721 .191262990236 .304376482964 .344187945127 .231027543545 .910033464432 "
            ".103736370802 .953962624073 -.281414330006"
        ),
        (
            "29.9215259552 90.3847808838 22.9222049713 0 -4.35502958298 -3.17343592644 48.013507843"
            " 42.5473213196"
        ),
    ),
}

LOW = np.array([0, 45 * DEG, 0.23, -182 * DEG, -70 * DEG, -105 * DEG, -105 * DEG])
HIGH = np.array([90 * DEG, 135 * DEG, 0.56, 182 * DEG, 70 * DEG, 105 * DEG, 105 * DEG])
SPAN = HIGH - LOW


OFFSET = {arm: np.array(oracle.OFFSETS[k]) for k, arm in enumerate(ARMS)}


def matrix(arm, jpos):
    """The oracle's pose as a 4 x 4 matrix."""
    rotation, position = oracle.forward(ARMS.index(arm), [*jpos[:5], (jpos[6] - jpos[5]) / 2])
    return np.block([[np.array(rotation), np.array(position)[:, None]], [0, 0, 0, 1]])


def solutions(arm, t06):
    """The oracle's theta [8, 6], valid [8], and its code, 0 or -2."""
    pose = t06[:3, :3].tolist(), t06[:3, 3].tolist()
    found, code = oracle.inverse(ARMS.index(arm), pose)
    return np.array([theta for theta, _ in found]), np.array([valid for _, valid in found]), code


def expected_inverse(arm, t06, grasp, jpos_ref):
    """The oracle's status and joints, None where rejected."""
    pose = t06[:3, :3].tolist(), t06[:3, 3].tolist()
    found, code = oracle.inverse(ARMS.index(arm), pose)
    reference = [*jpos_ref[:5], (jpos_ref[6] - jpos_ref[5]) / 2]
    theta = oracle.select(found, oracle.joint_to_theta(ARMS.index(arm), reference))
    if theta is None:
        return -1, None
    *first, yaw = oracle.theta_to_joint(ARMS.index(arm), theta)
    return code, np.array([*first, -yaw + grasp / 2, yaw + grasp / 2])


def vec(array) -> Vec:
    """The numbers of each row, as arrays of all rows."""
    return Vec(np.moveaxis(array, -1, 0))


def stacked(numbers) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*numbers), axis=-1).astype(np.float64)


def pose_of(position, rotation) -> Pose:
    return Pose(vec(position), Vec(vec(row) for row in np.moveaxis(rotation, -2, 0)))


def forward(arm, jpos, dtype=np.float64):
    """Positions and rotations."""
    pose = kinematics.forward_pose(arm, vec(np.asarray(jpos, dtype)))
    return stacked(pose.position), np.stack([stacked(row) for row in pose.rotation], axis=-2)


def inverse(arm, *rows, dtype=np.float64):
    """Joints, status, cost and yaw for position, rotation, opening and measured joints."""
    position, rotation, opening, measured = (np.asarray(row, dtype) for row in rows)
    ik = kinematics.inverse_joints(arm, pose_of(position, rotation), opening, vec(measured))
    return stacked(ik.jpos), ik.status, ik.cost, ik.yaw


def candidates(arm, t06):
    """theta [rows, 8, 6] and its validity [rows, 8]."""
    found = kinematics.inverse_candidates(arm, pose_of(t06[:, :3, 3], t06[:, :3, :3]))
    thetas = [stacked(dataclasses.astuple(theta)) for theta, _ in found]
    return np.stack(thetas, axis=1), stacked([valid for _, valid in found])


def jacobian(arm, jpos):
    return np.stack([stacked(row) for row in kinematics.tip_jacobian(arm, vec(jpos))], axis=-2)


@pytest.fixture(autouse=True)
def _numpy():
    """Functions of single numbers compute with arrays of them."""
    with run_eagerly(), np.errstate(all="ignore"):
        yield


def random_joints(count, seed=0, low=LOW, high=HIGH):
    return np.random.default_rng(seed).uniform(low, high, (count, 7))


def angle_between(a, b):
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)


# --- forward ---


@pytest.mark.parametrize("arm", ARMS)
def test_forward_of_a_recorded_robot(arm):
    micrometres, rotation, degrees = RECORDED[arm]
    jpos = np.delete(np.array(degrees.split(), float), 3) * DEG
    p, r = forward(arm, jpos[None])
    np.testing.assert_allclose(p[0] * 1e6, micrometres, atol=1.0)
    np.testing.assert_allclose(r[0].ravel(), np.array(rotation.split(), float), atol=1e-7)


@pytest.mark.parametrize("arm", ARMS)
def test_forward_equals_the_matrices(arm):
    jpos = random_joints(200, low=[-4, -4, 0, -4, -4, -4, -4], high=[4, 4, 1, 4, 4, 4, 4])
    p, r = forward(arm, jpos)
    expected = np.array([matrix(arm, q) for q in jpos])
    np.testing.assert_allclose(p, expected[:, :3, 3], atol=1e-14)
    np.testing.assert_allclose(r, expected[:, :3, :3], atol=1e-14)


# --- inverse ---


@pytest.mark.parametrize("arm", ARMS)
def test_candidates_equal_the_originals_equations(arm):
    jpos = np.concatenate(
        [random_joints(150, seed=1), random_joints(150, seed=2, low=[-3] * 7, high=[3] * 7)]
    )
    t06 = np.array([matrix(arm, q) for q in jpos])
    # The original does not ask for a rotation.
    t06[::3, :3, :3] += np.random.default_rng(3).normal(0, 0.05, (100, 3, 3))
    theta, valid = candidates(arm, t06)
    for i, t in enumerate(t06):
        expected, expected_valid, code = solutions(arm, t)
        if code:
            continue
        np.testing.assert_array_equal(valid[i].astype(bool), expected_valid)
        for got, want in zip(theta[i][expected_valid], expected[expected_valid], strict=True):
            singular = 1e-15 / min(abs(np.cos(want[4])), abs(np.sin(want[4])), abs(np.sin(want[1])))
            np.testing.assert_allclose(got[2], want[2], atol=1e-13)
            assert angle_between(got, want)[[0, 1, 3, 4, 5]].max() < 1e-11 + 1e3 * singular


def joints_away_from_the_remote_centre(count, seed):
    """Inside the limits, with both wrists farther than Lw from the remote centre and the roll
    not at its turn.
    """
    jpos = random_joints(count, seed)
    shallow, deep = np.minimum(jpos[:, 2], 0.43), np.maximum(jpos[:, 2], 0.51)
    jpos[:, 2] = np.where(jpos[:, 2] < 0.47, shallow, deep)
    jpos[:, 3] = np.clip(jpos[:, 3], -179 * DEG, 179 * DEG)
    return jpos


@pytest.mark.parametrize("arm", ARMS)
def test_round_trips_in_float32(arm):
    """Rounded poses lead back with the tip within 0.2 um.

    What a rounded position says about an angle gets less as the wrist nears the remote centre;
    about the roll, as the wrist straightens.
    """
    jpos = joints_away_from_the_remote_centre(4000, seed=4)
    p, r = forward(arm, jpos, np.float32)
    found, status, *_ = inverse(arm, p, r, jpos[:, 5] + jpos[:, 6], jpos, dtype=np.float32)
    error = np.abs(found - jpos)
    assert (status == 0).all()
    distance = np.abs(jpos[:, 2] - 0.47)  # m
    assert (error[:, :2] * distance[:, None]).max() < 0.1e-6
    assert error[:, 2].max() < 0.1e-6
    assert (error[:, 3] * np.abs(np.sin(jpos[:, 4])) * distance).max() < 0.2e-6
    assert (error[:, 4:] * distance[:, None]).max() < 0.2e-6
    again, _ = forward(arm, found)
    exact, _ = forward(arm, jpos)
    assert np.linalg.norm(again - exact, axis=1).max() < 0.2e-6


def selections(arm, count, seed, spread, low=LOW, high=HIGH):
    """Poses, openings and measured joints that are `spread` (share of the range) away, decided
    by both.
    """
    rng = np.random.default_rng(seed)
    jpos = rng.uniform(low, high, (count, 7))
    reference = jpos + spread * SPAN * rng.normal(size=(count, 7))
    t06 = np.array([matrix(arm, q) for q in jpos])
    opening = rng.uniform(0, 1.5, count)
    got = inverse(arm, t06[:, :3, 3], t06[:, :3, :3], opening, reference)
    return got, [
        expected_inverse(arm, t, g, q) for t, g, q in zip(t06, opening, reference, strict=True)
    ]


def agree(got, expected):
    found, status, *_ = got
    for i, (want_status, want) in enumerate(expected):
        assert status[i] == want_status
        if want is not None:
            np.testing.assert_allclose(found[i], want, atol=1e-8)
    return np.array([status for status, *_ in expected])


@pytest.mark.parametrize("arm", ARMS)
def test_selection_and_rejection_follow_the_original(arm):
    statuses = [
        agree(*selections(arm, 150, 10 + k, spread))
        for k, spread in enumerate((0.01, 0.05, 0.2, 1.0))
    ]
    assert (statuses[0] == 0).mean() > 0.8 and (statuses[3] == -1).mean() > 0.5


@pytest.mark.parametrize("arm", ARMS)
def test_at_the_remote_centre_the_originals_leftovers_are_selected(arm):
    """Insertions where the wrist is within Lw of the remote centre on one side or both."""
    low, high = LOW.copy(), HIGH.copy()
    low[2], high[2] = 0.445, 0.495
    statuses = agree(*selections(arm, 400, 20, 0.05, low, high))
    assert (statuses == -1).sum() > 100
    # A measured pose chosen so near the leftovers that they are taken: joints of all-zero angles.
    t06 = matrix(arm, joints(20, 50, 0.459, 3, 60, 0, 0))
    insertion = -solutions(arm, t06)[0][0, 2] + 0.47
    assert solutions(arm, t06)[2] == -2
    reference = np.array(
        [-OFFSET[arm][0], -OFFSET[arm][1], 0.47 - insertion, 0.1, 85 * DEG, 0.1, 0.1]
    )
    expected = expected_inverse(arm, t06, 0.2, reference)
    found, status, *_ = inverse(arm, t06[None, :3, 3], t06[None, :3, :3], [0.2], reference[None])
    assert expected[0] == status[0] == -2
    np.testing.assert_allclose(found[0], expected[1], atol=1e-12)


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("beyond", [0.0, 2e-6, 9e-6, 1.1e-5])
@pytest.mark.parametrize("end", [1.0, -1.0])
def test_elbow_stretched_a_little_beyond_its_end(arm, beyond, end):
    """Poses whose cosine of theta2 is outside [-1, 1] are clamped within 1e-5, invalid farther
    off.
    """
    q = joints(30, 0.0 if (end > 0) == (arm == "green") else 180.0, 0.35, 20, 25, 10, 30)
    t06 = matrix(arm, q)
    theta = oracle.joint_to_theta(ARMS.index(arm), [*q[:5], (q[6] - q[5]) / 2])
    wrist = np.array(oracle.chain(oracle.links(ARMS.index(arm), theta)[:5])[1])
    d = np.linalg.norm(wrist)
    # Tilt the whole pose about the axis that is perpendicular to shoulder axis and wrist.
    axis = np.cross([0, 0, 1.0], wrist / d)
    axis /= np.linalg.norm(axis)
    # d = -|d| here, so that the cosine follows -z/d of gold and z/d of green
    side = 1.0 if arm == "gold" else -1.0
    z = wrist[2] + side * end * beyond * oracle.GM1 * oracle.GM3 * d
    turn = np.arcsin(wrist[2] / d) - np.arcsin(z / d)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation = np.eye(3) + np.sin(turn) * k + (1 - np.cos(turn)) * k @ k
    t06[:3] = rotation @ t06[:3]
    expected, expected_valid, _ = solutions(arm, t06)
    theta, valid = (x[0] for x in candidates(arm, t06[None]))
    if beyond:  # at the end itself rounding decides
        np.testing.assert_array_equal(valid.astype(bool), expected_valid)
        assert valid[4:6].any() == (beyond < 1e-5)
    both = valid.astype(bool) & expected_valid
    assert both.any()
    assert angle_between(theta[both], expected[both]).max() < (1e-10 if beyond else 1e-6)


@pytest.mark.parametrize("wrist", [0.0, 1e-6 / DEG, 90.0 - 3e-4, 3e-4 - 90.0])
@pytest.mark.parametrize("arm", ARMS)
def test_singular_wrists_take_the_other_equations(arm, wrist):
    q = joints(35, 70, 0.36, 40, wrist, 10, 30)
    p, r = forward(arm, q[None])
    found, status, *_ = inverse(arm, p, r, [q[5] + q[6]], q[None])
    assert status[0] == 0
    np.testing.assert_allclose(found[0], q, atol=1e-9)


def test_roll_is_shifted_when_the_measured_one_is_more_than_300_degrees_away():
    target, measured = joints(30, 90, 0.4, 175, 20, 45, 45), joints(30, 90, 0.4, -130, 20, 45, 45)
    measured[3] = -126 * DEG
    p, r = forward("gold", target[None])
    found, *_ = inverse("gold", p, r, [1.5], measured[None])
    assert found[0][3] == pytest.approx((175 - 360) * DEG)
    measured[3] = -124 * DEG
    found, status, *_ = inverse("gold", p, r, [1.5], measured[None])
    assert status[0] == -1


def test_a_pose_with_nan_is_rejected():
    p, r = forward("gold", HOME[None])
    for bad_p, bad_r in ((p * np.nan, r), (p, r * np.nan)):
        _, status, cost, _ = inverse("gold", bad_p, bad_r, [1.5], HOME[None])
        assert status[0] == -1 and cost[0] == 32765


@settings(max_examples=100, deadline=None)
@example(share=[0.0] * 7, nudge=[0.0] * 7)
@given(
    share=st.lists(st.floats(0, 1), min_size=7, max_size=7),
    nudge=st.lists(st.floats(-1, 1), min_size=7, max_size=7),
)
def test_whatever_is_taken_reaches_the_pose(share, nudge):
    """Where the inverse takes a solution, forward of it is the pose."""
    jpos = LOW + np.array(share) * SPAN
    reference = jpos + 0.1 * SPAN * np.array(nudge)
    p, r = forward("gold", jpos[None])
    found, status, cost, _ = inverse("gold", p, r, jpos[5:6] + jpos[6:7], reference[None])
    if status[0] != 0:
        return
    again, r_again = forward("gold", found)
    np.testing.assert_allclose(again, p, atol=1e-9)
    np.testing.assert_allclose(r_again, r, atol=1e-8)
    assert cost[0] <= np.pi


# --- velocities ---


@pytest.mark.parametrize("arm", ARMS)
def test_jacobian_equals_finite_differences(arm):
    jpos = random_joints(40, seed=5)
    got = jacobian(arm, jpos)
    step = 1e-6
    for column in range(6):
        move = np.zeros(7)
        if column < 5:
            move[column] = step
        else:
            move[5:] = -step, step
        (before, r0), (after, r1) = forward(arm, jpos - move), forward(arm, jpos + move)
        np.testing.assert_allclose(got[:, :3, column], (after - before) / (2 * step), atol=1e-9)
        skew = (r1 - r0) / (2 * step) @ forward(arm, jpos)[1].transpose(0, 2, 1)
        turning = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        np.testing.assert_allclose(got[:, 3:, column], turning, atol=1e-8)


@pytest.mark.parametrize("arm", ARMS)
def test_tip_velocity_is_the_jacobians(arm):
    jpos, jvel = random_joints(40, seed=6), np.random.default_rng(7).normal(size=(40, 7))
    got = stacked(kinematics.tip_velocity(arm, vec(jpos), vec(jvel)))
    rates = np.concatenate([jvel[:, :5], (jvel[:, 6:] - jvel[:, 5:6]) / 2], axis=1)
    np.testing.assert_allclose(
        got, np.einsum("nij,nj->ni", jacobian(arm, jpos)[:, :3], rates), atol=1e-14
    )


# --- angles ---


@given(st.floats(-50, 50))
def test_wrap_brings_into_half_a_turn(angle):
    wrapped = float(wrap_angle(np.float64(angle)))
    assert abs(wrapped) <= np.pi + 1e-12
    turns = (angle - wrapped) / (2 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-12)

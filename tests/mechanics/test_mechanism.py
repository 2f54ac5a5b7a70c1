"""The time step of any tree of joints against C MuJoCo, and what it refuses."""

import subprocess
import sys

import mujoco
import numpy as np
import pytest

from ravenjax.errors import UserError
from ravenjax.mechanics.mechanism import read_mechanism, step, tip_position
from ravenjax.numbers.lazy import run_eagerly
from ravenjax.numbers.vec import Vec

HEAD = """<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast">
<flag contact="disable"/></option><worldbody>"""


def chain(*links: str, tip: str, after: str = "") -> str:
    """Bodies one inside the other."""
    inner = f'<site name="tip" pos="{tip}"/>' + "</body>" * len(links)
    return f"{HEAD}{''.join(links)}{inner}</worldbody>{after}</mujoco>"


def link(place: str, joint: str, mass: float, com: str, inertia: str) -> str:
    body = f"mass='{mass}' pos='{com}' diaginertia='{inertia}'"
    return f"<body {place}><joint {joint}/><inertial {body}/>"


# Universal Robots: "DH parameters for calculations of kinematics and dynamics" (inertias assumed).
Y, LIGHT = "axis='0 1 0' armature='0.1' damping='2'", "2e-3 2e-3 2e-3"
ARM = chain(
    link("pos='0 0 0.1625'", "armature='0.1' damping='2'", 3.761, "0 -.02561 .00193", LIGHT),
    link("euler='0 1.5708 0'", Y, 8.058, "0 0 .2125", ".13 .13 .02"),
    link("pos='0 0 .425'", Y, 2.846, "0 0 .15", ".03 .03 .004"),
    link("pos='0 .1333 .3922'", Y, 1.37, "0 -.0018 .01634", LIGHT),
    link("pos='0 0 .0997'", "damping='1' armature='.1'", 1.3, "0 .0018 .01634", LIGHT),
    link("pos='0 .0996 0'", Y, 0.365, "0 0 -.001159", "2e-4 2e-4 2e-4"),
    tip="0 0 .05",
)
# Lengths and masses of a finger of the Allegro hand (allegro_hand_description), with springs and a
# coupled last joint, as hands with tendons have it.
FINGER = "axis='0 1 0' damping='.01' armature='1e-4' stiffness='.1' springref='.2'"
HAND = chain(
    link("", "name='side' damping='.01' armature='1e-4'", 0.01195, "0 0 .008", "1e-6 1e-6 1e-6"),
    link("pos='0 0 .0164'", FINGER, 0.065, "0 0 .027", "2e-5 2e-5 5e-6"),
    link("pos='0 0 .054'", f"name='middle' {FINGER}", 0.0355, "0 0 .019", "6e-6 6e-6 2e-6"),
    link("pos='0 0 .0384'", f"name='distal' {FINGER}", 0.0096, "0 0 .013", "1e-6 1e-6 5e-7"),
    tip="0 0 .0267",
    after="<equality><joint joint1='distal' joint2='middle' polycoef='.05 .7 .1 0 0'/></equality>",
)
LOSS = "damping='.5' armature='.02'"
SCARA = chain(
    link("pos='0 0 .4'", f"{LOSS} frictionloss='1.5'", 6.0, ".16 0 0", ".02 .08 .08"),
    link("pos='.325 0 0'", f"{LOSS} frictionloss='.8'", 4.0, ".13 0 0", ".01 .04 .04"),
    link("pos='.275 0 0'", "type='slide' damping='9' frictionloss='5'", 1.5, "0 0 0", LIGHT),
    link("", "damping='.02' armature='1e-3' frictionloss='.05'", 0.3, "0 0 -.1", LIGHT),
    tip="0 0 -.2",
)


@pytest.mark.parametrize(
    ("text", "kp", "kv", "most"),
    [(ARM, 4500.0, 450.0, 1e-12), (HAND, 0.5, 0.01, 1e-12), (SCARA, 40.0, 4.0, 1e-5)],
    ids=["arm", "hand", "scara"],
)
def test_its_step_is_that_of_mujoco(text, kp, kv, most):
    """400 steps under a position controller whose velocity gain the step takes implicitly."""
    spec = mujoco.MjSpec.from_string(text)
    for k, joint in enumerate(spec.joints):
        joint.name = joint.name or f"j{k}"  # for its actuator
        actuator = spec.add_actuator(target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=kp, kv=kv)
    model = spec.compile()
    data, mechanism = mujoco.MjData(model), read_mechanism(model, "tip")
    n = model.nv
    goal = np.linspace(0.1, 0.4, n)
    data.ctrl[:] = goal
    qpos, qvel, gain, apart = Vec((0.0,) * n), Vec((0.0,) * n), Vec.full(n, kv), []
    with run_eagerly():
        for _ in range(400):
            torque = Vec(goal.tolist()).map(lambda g, q, v: kp * (g - q) - kv * v, qpos, qvel)
            qpos, qvel = step(mechanism, qpos, qvel, torque, gain)
            mujoco.mj_step(model, data)
            apart.append(np.abs(np.array(qpos) - data.qpos).max())
        mujoco.mj_kinematics(model, data)
        tip = tip_position(mechanism, Vec(data.qpos.tolist()))
    assert max(apart) < most and np.abs(data.qpos).max() > 0.05
    np.testing.assert_allclose(tip, data.site("tip").xpos, rtol=0, atol=1e-12)


def test_what_it_has_not_is_named():
    body = "<body name='b'>{}<geom name='g' size='.1'/></body>"
    text = (
        "<mujoco><option density='1'/><worldbody>"
        + body.format("<freejoint name='f'/>")
        + "<body><joint name='j'/><geom size='.1'/></body></worldbody>"
        "<tendon><fixed name='t'><joint joint='j' coef='1'/></fixed></tendon>"
        "<equality><weld name='w' body1='b'/></equality></mujoco>"
    )
    with pytest.raises(UserError) as error:
        read_mechanism(mujoco.MjModel.from_xml_string(text), "tip")
    for word in ("joints (f)", "tendons (t)", "(w)", "switches off (g, number 1)", "density"):
        assert word in str(error.value)


IMPORT_IN_TWO_THREADS = """
import concurrent.futures, mujoco
from ravenjax.mechanics import mechanism
with concurrent.futures.ThreadPoolExecutor(2) as pool:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    list(pool.map(mechanism._put_model, [model] * 2, ["float32", "float64"]))
print("standard output is kept")
"""


@pytest.mark.slow
def test_two_threads_that_import_mjx_keep_standard_output():
    # Both threads redirect the output of the import, which only a fresh process repeats.
    command = [sys.executable, "-c", IMPORT_IN_TWO_THREADS]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "standard output is kept\n"

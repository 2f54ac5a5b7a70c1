"""Where the control software starts: at a pose, without a jump; at encoders; in a state, to the
bit.
"""

import copy
import math
import pickle
import random

import numpy as np
import pytest
import rig_control_software as rig
from drives import Drive
from test_arithmetic import same_bits

from ravenjax.errors import UserError
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.software.control_software import ControlSoftware

DEG = math.pi / 180
HOME = [list(HOME_JPOS)] * 2
STILL, UNIT = [[0.0] * 3] * 2, [[0.0, 0.0, 0.0, 1.0]] * 2


def legal_joints(rng: random.Random) -> list[float]:
    """Within the software's limits and openings, the tip 2 cm and more from the remote centre,
    the wrist bent.
    """
    opening, yaw = rng.uniform(-9, 89), rng.uniform(-55, 55)
    angles = [rng.uniform(1, 89), rng.uniform(46, 134), 0.0, rng.uniform(-179, 179)]
    angles += [rng.choice((-1, 1)) * rng.uniform(5, 69), opening / 2 - yaw, opening / 2 + yaw]
    joints = [angle * DEG for angle in angles]
    joints[2] = rng.uniform(0.24, 0.43)
    return joints


def commands(output):
    return np.array([arm.current_cmd for arm in output.signals.arms])


def jump(software, encoders, openings=(0, 0)):
    """Largest change of a DAC command (counts) from pedal-up to any of the first cycles in
    pedal-down.
    """
    levels = [0] * 6 + [1] * 30 + [2] * 15 + [3] * 15
    up, largest = None, 0
    for number, level in enumerate(levels):
        still = rig.datagram(number + 1, STILL, UNIT, openings, 1)
        output = software.step(encoders, still, level << 6)
        if output.signals.runlevel == 2:
            up = commands(output)
        elif output.signals.runlevel == 3:
            largest = max(largest, int(abs(commands(output) - up).max()))
    assert output.signals.runlevel == 3 and not output.signals.soft_estopped
    return largest


@pytest.mark.slow
def test_no_command_jumps_at_the_first_pedal_down():
    """A pose is kept in whole micrometres and milliradians: that is worth a few counts. From
    home: thousands.
    """
    rng, jumps = random.Random(1), []
    for _ in range(50):
        joints = [legal_joints(rng), legal_joints(rng)]
        there = ControlSoftware(jpos=joints)
        encoders = np.array(there.state.usb.enc_val)
        jumps.append(jump(there, encoders))
        assert jump(ControlSoftware(encoders=encoders), encoders) == jumps[-1]
    assert max(jumps) <= 20, jumps


def test_from_home_a_robot_that_stands_elsewhere_jumps():
    joints = [list(HOME_JPOS), list(HOME_JPOS)]
    joints[0][5:] = [25 * DEG, 25 * DEG]  # 40 deg less open: the original keeps the opening it had
    there = ControlSoftware(jpos=joints)
    encoders = np.array(there.state.usb.enc_val)
    assert jump(there, encoders) <= 20
    assert jump(ControlSoftware(), encoders) > 1000


@pytest.mark.parametrize("software", ["raven2", "fork2015"])
def test_pedal_down_from_the_first_cycle_on_asks_for_what_is_there(software):
    rng = random.Random(2)
    for _ in range(5):
        there = ControlSoftware(software, jpos=[legal_joints(rng)] * 2, runlevel=3)
        output = there.step(np.array(there.state.usb.enc_val), pins=0b11 << 6)
        for arm in output.signals.arms:
            # In rad; the insertion motor turns 2 rad a mm.
            assert np.abs(np.subtract(arm.mpos_d, arm.mpos)).max() < 0.02


def arrived(seed: int, ticks: int, options: dict):
    """A software in the midst of it, and how its robot goes on."""
    software = ControlSoftware(**options)
    drive = Drive(seed, software, 0.01)
    for cycle in drive.cycles(ticks):
        drive.obey(software.step(cycle.encoders, cycle.packet, cycle.pins, cycle.read_ok).dac)
    return software, drive


OPTIONS = {
    "raven2": {},
    "one arm": {"arms": ("green",)},
    "fork2015": {"software": "fork2015"},
    "absolute": {"software": "fork2015", "console": "absolute"},
}


@pytest.mark.slow
@pytest.mark.parametrize("form", list(OPTIONS))
def test_a_state_goes_on_to_the_bit(form):
    options = OPTIONS[form]
    one, drive = arrived(5, 700, options)
    state = pickle.loads(pickle.dumps(one.state))
    others = [
        ControlSoftware(**options, state=state, arithmetic=way)
        for way in ("compiled", "interpreted")
    ]
    for cycle in drive.cycles(300):
        arguments = cycle.encoders, cycle.packet, cycle.pins, cycle.read_ok
        output = one.step(*arguments)
        drive.obey(output.dac)
        for other in others:
            assert same_bits(one.code.kinds["signals"], output._row, other.step(*arguments)._row)
    for other in others:
        assert same_bits(one.code.kinds["state"], one._state, other._state)


def test_a_copy_goes_its_own_way():
    software, drive = arrived(8, 50, {})
    there = software.state
    twins = [copy.copy(software), copy.deepcopy(software)]
    outputs = []
    for cycle in drive.cycles(20):
        arguments = cycle.encoders, cycle.packet, cycle.pins, cycle.read_ok
        outputs.append((arguments, software.step(*arguments)))
    assert all(twin.state == there != software.state for twin in twins)
    assert all(twin.step(*arguments) == output for arguments, output in outputs for twin in twins)


def refused(words, **options):
    with pytest.raises(UserError) as error:
        ControlSoftware(**options)
    for word in words:
        assert word in str(error.value), str(error.value)


def test_a_wrong_start_is_named():
    one_arm = ControlSoftware(arms=["gold"]).state
    wrong = ControlSoftware().state
    degrees = [[30, 90, 0.4, 0, 0, 45, 45]] * 2
    refused(("jpos has shape (7,)", "[2, 7]", "rad and m", "shoulder, elbow"), jpos=HOME[0])
    refused(("jpos[0][0] (shoulder) is 30.0", "-6.3..6.3 rad", "not degrees"), jpos=degrees)
    refused(
        ("jpos and state are given", "expected only one of jpos, encoders, state"),
        jpos=HOME,
        state=wrong,
    )
    refused(("runlevel is 3", "state contains a run level"), runlevel=3, state=wrong)
    refused(("state.", "arms has 1 entries, expected 2"), state=one_arm)

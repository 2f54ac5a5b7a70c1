"""Faults on parameters: a number of the robot is another one while a fault's window is open."""

import numpy as np
import pytest

import ravenjax as rj

KP, STIFFNESS = "control.motor_control.gold.kp.shoulder", "plant.gold.cable_stiffness.insertion"


def struck(channel=KP, effect="overwrite", value=0.6, start_ms=0, **more):
    fault = {"site": "parameter", "channel": channel, "effect": effect, "value": value}
    return {**fault, "start_ms": start_ms, **more}


def campaign(*groups):
    return {"campaign": {"name": "worn", "duration_s": 1.0}, "group": list(groups)}


@pytest.fixture(scope="module")
def table():
    return rj.run(
        campaign(
            {"name": "fault", "fault": [struck(start_ms=[0, 600])]},
            {"name": "parameter", "parameters": {KP: 0.6}},
            {"name": "same", "fault": [struck(effect="scale", value=1.0, start_ms=600)]},
            {"name": "cable", "fault": [struck(STIFFNESS, "scale", 0.01, 600, duration_ms=50)]},
            {"name": "software", "fault": [struck("control.overdrive.max_inst_dac", value=1)]},
        ),
        engine="simd",
    ).set_index("group")


def test_a_fault_from_the_beginning_moves_the_robot_as_the_parameter_does(table):
    robot = ["tip_path_mm", "largest_step_mm", "peak_dac_gold_shoulder", "peak_model_deviation_mm"]
    fault, parameter = table.loc["fault"].iloc[0], table.loc["parameter"]
    assert fault[robot].tolist() == parameter[robot].tolist()
    # the golden run of the fault has the usual gain, that of the parameter has not
    assert fault["diverged"] and not parameter["diverged"]
    assert fault["peak_golden_deviation_mm"] > 0.1 and parameter["peak_golden_deviation_mm"] == 0.0


def test_a_fault_acts_in_its_window_only(table):
    late, same, cable = table.loc["fault"].iloc[1], table.loc["same"], table.loc["cable"]
    assert (late["first_active_ms"], late["active_ticks"]) == (600, 400)
    assert not same["activated"] and not same["diverged"]
    assert cable["diverged"] and (cable["active_ticks"], cable["applied0_last_ms"]) == (50, 649)
    assert np.isfinite(cable["peak_golden_deviation_mm"])
    assert table.loc["software"]["response_cause"] == "overdrive"


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (struck("control.motor_control.kp.shoulder"), f"Did you mean '{KP}'"),
        (struck("pid.kp.gold.sholder"), f"Did you mean '{KP}'"),
        (struck("nominal.gold.kp.shoulder"), "cannot change during a run"),
        (struck("plant.gold.kinematic_errors.scale"), "cannot change during a run"),
        (struck("control.overdrive.dac_max.grasp2", value=20), "has no effect"),
        (struck("plant.gold.mass_scale", value=-1.0), "is a parameter"),
        (struck(channel=None), "see `ravenjax parameters`; write one"),
    ],
)
def test_what_no_fault_can_change_is_refused(fault, words):
    fault = {key: value for key, value in fault.items() if value is not None}
    with pytest.raises(rj.UserError) as error:
        rj.run(campaign({"name": "g", "fault": [fault]}), engine="simd")
    assert words in str(error.value) and str(error.value).count("fault[0]") == 1

"""The robot of a session is the robot of a campaign: same motion, same fault, same bits, however
it is stepped.
"""

import numpy as np
import pytest
from made_frames import made as made_scenario

from ravenjax.campaign import loading
from ravenjax.campaign.inspection import replay
from ravenjax.errors import UserError
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.train.judge import Judge
from ravenjax.train.protocol import Frame
from ravenjax.train.session import simulation
from ravenjax.train.session.simulation import PacketRobot, SimulatedRobot

TICKS, START = 900, 600
BURST = {"site": "usb_out", "arm": "gold", "channel": "shoulder", "effect": "overwrite"}
FAULTS = {
    "pedal": {"site": "packet_header", "channel": "surgeon_mode", "effect": "overwrite"},
    "encoder": {"site": "encoder", "arm": "gold", "channel": "shoulder", "effect": "drift"},
    "stop": {"site": "runlevel", "channel": "rl_desired", "effect": "overwrite"},
}
VALUES = {"pedal": 0, "encoder": 30, "stop": 0}
BUTTON = {"site": "buttons", "channel": "estop", "effect": "overwrite", "value": 1, "start_ms": 0}


def config(**fault):
    struck = BURST | {"value": 9000, "start_ms": START, "duration_ms": 24} | fault
    others = {
        name: {**one, "value": VALUES[name], "start_ms": START} for name, one in FAULTS.items()
    }
    faults = {"burst": struck, **({} if fault else others), "estop": BUTTON}
    groups = [{"name": name, "fault": [one]} for name, one in faults.items()]
    return loading.from_dict(
        {
            "campaign": {"name": "live", "duration_s": TICKS / 1000, "arms": ["gold", "green"]},
            "operator": {"motion": "suture", "scale": 0.1},
            "group": groups,
        }
    )


@pytest.fixture(scope="module")
def made():
    return simulation.make_blueprint(config())


def robot_of(made):
    robot = SimulatedRobot(made)
    for column, values in zip(robot.motion, made.plan.columns, strict=True):
        column[: len(values)], column[len(values) :] = values, values[-1]
    return robot


def run(robot, ticks):
    return np.stack([(robot.step(), robot.row.copy())[1] for _ in range(ticks)])


def by_the_rules(series, arm, live):
    """Distances of an arm by the definitions of outcomes, mm, from the series of its run in the
    campaign.
    """
    tip, golden = series[f"{arm}/tip"].astype(float), series[f"{arm}/golden_tip"].astype(float)

    def size(vectors):
        return np.linalg.norm(vectors, axis=-1)

    asked = np.diff(golden, axis=0, prepend=golden[:1])
    idle = (size(asked) > 1e-6) & (size(np.diff(tip, axis=0, prepend=tip[:1])) < 0.25 * size(asked))
    missed = np.cumsum(np.where((idle | ~live)[:, None], asked, 0.0), axis=0)
    from_golden, standing = size(tip - golden), size(tip - golden + missed)
    from_both = np.minimum(from_golden, size(tip - series[f"{arm}/model_position"]))
    unintended = np.minimum(from_both, standing) * 1e3
    loss = (2 * standing < from_both) | ((from_both * 1e3 > LIMIT_MM) & (unintended <= LIMIT_MM))
    return {
        "unintended_mm": unintended * live,
        "unintended_off_mm": np.minimum(from_golden, standing) * 1e3 * ~live,
        "loss_mm": from_both * 1e3 * (loss & live),
    }


@pytest.mark.slow
def test_an_armed_row_does_what_it_does_in_its_campaign(made):
    robot = robot_of(made)
    before = run(robot, START)
    robot.arm(0)
    rows = np.concatenate([before, run(robot, TICKS - START)])
    again = replay.Replayer(config(), "simd").replay(0)
    places = made.layout.places
    live = rows[:, places["live"]].ravel() != 0
    np.testing.assert_array_equal(
        live, (again.series["runlevel"] == 3) & (again.series["soft_estopped"] == 0)
    )
    for arm in ("gold", "green"):
        for name in ("jpos", "link_jpos", "tip", "dac"):
            series = again.series[f"{arm}/{'dac_cnt' if name == 'dac' else name}"]
            mine = rows[:, places[f"{arm}/{name}"]]
            np.testing.assert_array_equal(mine, series.astype(np.float32), err_msg=name)
        for name, distance in by_the_rules(again.series, arm, live).items():
            np.testing.assert_allclose(
                rows[:, places[f"{arm}/{name}"]].ravel(), distance, atol=1e-3, err_msg=name
            )
    active = rows[:, places["fault_active"]].ravel()
    assert (active[:START].sum(), active[START:].sum()) == (0, 24)
    outcomes = robot.outcomes()
    first = ("first_active_ms", "cue0_first_ms", "check_soft_estop_first_ms")
    for name in (*first, "halted_ms", "end_runlevel"):
        assert outcomes[name] == pytest.approx(again.row[name], nan_ok=True, rel=1e-6), name
    for name in ("unintended_mm", "unintended_off_mm", "loss_mm", "false_report_mm"):
        peak = max(rows[:, places[f"{arm}/{name}"]].max() for arm in ("gold", "green"))
        assert outcomes[name] == pytest.approx(peak, rel=1e-6), name
        assert outcomes[name] == pytest.approx(again.row[name], abs=1e-4), name


@pytest.mark.slow
@pytest.mark.parametrize("row", range(4), ids=["burst", *FAULTS])
def test_a_session_says_of_a_hazard_what_the_table_of_its_campaign_says(made, row):
    again = replay.Replayer(config(), "simd").replay(row).row
    robot, frame = robot_of(made), Frame(made.layout)
    harm = {"excursion_mm": LIMIT_MM}  # as the campaign has it
    judge = Judge(
        *made_scenario(hazard=[{"fault": [{**FAULTS["stop"], "value": 0}]}], harm=harm),
        cue_on=True,
        record=lambda *_, **__: None,
    )
    frame["pedal"] = frame["console_alive"] = 1
    for now in range(TICKS):
        if now == START:
            robot.arm(row)
            judge.begin_hazard(0, now)
        robot.step()
        frame.row[: robot.row.size] = robot.row
        frame.copy_numbers()
        judge.step(now, frame, robot.outcomes(), robot.golden_outcomes())
    (told,) = judge.rows()
    assert (told["check_response"], told["motion_hazard"]) == (again["response"], again["hazard"])
    for name in ("unintended_mm", "unintended_off_mm", "loss_mm", "false_report_mm"):
        assert told[name] == pytest.approx(again[name], abs=1e-3), name
    for name in ("unintended_first_ms", "loss_first_ms", "false_report_first_ms"):
        assert (-1 if told[name] is None else told[name]) == again[name], name
    beyond, expected = (one["halted_ms"] - one["golden_halted_ms"] for one in (told, again))
    assert beyond == expected
    assert (-1 if told["alarm_ms"] is None else told["alarm_ms"]) == again["told_ms"]
    limited = {"response_ms": told["limited_ms"], "response_cause": told["limited"]}
    limited["response"] = "limited"
    assert told["limited"] is None or limited.items() <= dict(again).items()
    others = {"pedal": "loss of motion", "stop": "none"}
    assert told["motion_hazard"] == others.get(["burst", *FAULTS][row], "unintended motion")


def test_a_robot_with_a_console_elsewhere_refuses_faults_of_that_console():
    with pytest.raises(UserError, match="site 'network', channel 'delay'"):
        PacketRobot(config(site="network", arm=None, channel="delay", effect="overwrite", value=3))

"""Every command for the arm of an MJCF file, and for a module that declares such an arm."""

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ravenjax as rj
from ravenjax import resources
from ravenjax.analyses.deadline import Actor, FaultActions
from ravenjax.campaign.plan import make_plan
from ravenjax.cli import main
from ravenjax.errors import UserError
from ravenjax.robots import find_robot

ARMS = {
    "planar_arm": ("elbow", "parameters.kp = 40\nparameters.kd = 2", "[-5, 5]"),
    "arm.xml": ("wrist_1", "", "[-60, 60]"),
}
FILE = """
campaign = {{ name = "arm", robot = "{robot}", duration_s = 1.0 }}
parameters.tracking = 0.5
parameters.velocity = 9
{parameters}
[[group]]
name = "drawn"
design = "random"
runs = 12
[[group.fault]]
site = "actuator"
channel = "{joint}"
effect = "offset"
value = {{ uniform = {value} }}
start_ms = 600
duration_ms = 100
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copy(resources.find_model("ur5e/ur5e.xml"), tmp_path / "arm.xml")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_campaign(path: Path, robot: str, search: str = "") -> None:
    joint, parameters, value = ARMS[robot]
    text = FILE.format(robot=robot, joint=joint, parameters=parameters, value=value)
    drawn = 'design = "random"\nruns = 12\n'
    path.write_text(text.replace(drawn, "") + search if search else text)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ARMS)
def test_every_command_works(folder, robot, capsys):
    write_campaign(folder / "arm.toml", robot)
    write_campaign(
        folder / "search.toml",
        robot,
        '[search]\nkind = "boundary"\nharm = "peak_golden_deviation_mm >= 1"\nscan = 5\n',
    )
    simd = ("--engine", "simd")
    for words in (
        ("check", "arm.toml", "--trust"),
        ("run", "arm.toml", "--out", "a", *simd),
        ("run", "arm.toml", "--out", "b", *simd, "--set", "parameters.gravity=0.9"),
        ("report", "a"),
        ("verify", "a"),
        ("trace", "a", "--worst", "1"),
        ("explain", "a"),
        ("compare", "a", "b"),
        ("deadline", "a"),
        ("coverage", "a"),
        (
            "counterfactual",
            "a",
            "--out",
            "c",
            "--hours",
            "0.02",
            "--false-alarms-per-hour",
            "100",
            *simd,
        ),
        ("search", "search.toml", "--out", "s", *simd),
        ("explore", "arm.toml", "-o", "page.html"),
        ("faults", "--robot", robot, "--trust"),
        ("parameters", "--robot", robot, "--trust"),
    ):
        assert main([*words]) == 0, (words, capsys.readouterr().err)


def set_period(file: Path, step_ms: float, tick_ms: int | None = None) -> None:
    text = file.read_text().replace('timestep="0.001"', f'timestep="{step_ms / 1e3}"')
    number = f'<custom><numeric name="period_ms" data="{tick_ms}"/></custom></mujoco>'
    file.write_text(text.replace("</mujoco>", number) if tick_ms is not None else text)


@pytest.mark.parametrize(
    ("step_ms", "written_ms", "tick_ms"),
    [(1, None, 1), (2, None, 2), (0.5, None, 1), (2.5, None, 5), (1, 4, 4)],
)
def test_its_tick_moves_as_c_mujoco(folder, step_ms, written_ms, tick_ms):
    """Position servos, damping, gravity that the controller carries, and the force of a fault."""
    write_campaign(folder / "arm.toml", "arm.xml")
    set_period(folder / "arm.xml", step_ms, written_ms)
    row = rj.run("arm.toml", engine="simd").iloc[1]
    run = rj.simulate("arm.toml", 1, engine="simd").sel(arm="arm")
    assert run["tip_error_mm"][:600].max() == 0.0, "a fault-free arm equals its nominal model"
    model = mujoco.MjModel.from_xml_path("arm.xml")
    data, places = mujoco.MjData(model), []
    data.qpos[:] = run["jpos"].values[0]
    for ms, plan in enumerate(run["jpos_d"].values):
        if ms % tick_ms:
            places.append(places[-1])
            continue
        still = mujoco.MjData(model)
        still.qpos[:] = data.qpos
        mujoco.mj_forward(model, still)
        data.ctrl[:], data.qfrc_applied[:] = plan, still.qfrc_bias
        data.qfrc_applied[3] += row["fault0_value"] * (600 <= ms < 700)
        mujoco.mj_step(model, data, round(tick_ms / step_ms))
        places.append(data.qpos.copy())
    assert np.ptp(places, axis=0).min() > 0.05 and row["peak_golden_deviation_mm"] > 0.3
    np.testing.assert_allclose(run["link_jpos"], places, rtol=0, atol=2e-6)


def test_a_fault_on_a_gain_moves_the_arm_as_the_parameter_does(folder):
    fault = {"site": "parameter", "channel": "kp.wrist_1", "start_ms": 0}
    groups = [
        {"name": "fault", "fault": [fault | {"effect": "overwrite", "value": 20}]},
        {"name": "parameter", "parameters": {"kp.wrist_1": 20}},
        {"name": "half", "fault": [fault | {"effect": "scale", "value": 0.5, "start_ms": 700}]},
    ]
    campaign = {"name": "worn", "robot": "arm.xml", "duration_s": 1.0}
    table = rj.run({"campaign": campaign, "group": groups}, engine="simd")
    fault, parameter, half = (row for _, row in table.iterrows())
    for column in ("tip_path_mm", "largest_step_mm"):
        assert fault[column] == parameter[column] != half[column]
    # The golden run of the fault has the model's gain, and so has the nominal model.
    assert fault["peak_golden_deviation_mm"] > 0.1 and parameter["peak_golden_deviation_mm"] == 0.0
    assert fault["peak_model_deviation_mm"] > 0.1 > parameter["peak_model_deviation_mm"]
    assert (half["first_active_ms"], half["active_ticks"]) == (700, 300)


def test_an_action_is_the_fault_that_does_the_same(folder):
    """A stop is that of a check that trips; holding the command is the effect `stuck`."""
    at = {"site": "command", "channel": "elbow", "start_ms": 700}
    push = at | {"site": "actuator", "effect": "offset", "value": 60}
    stop = at | {"site": "parameter", "channel": "tracking.elbow", "effect": "overwrite"}
    hold = [at | {"effect": "stuck", "channel": joint} for joint in find_robot("arm.xml").joints]
    campaign = {"name": "acted", "robot": "arm.xml", "duration_s": 1.0}
    plain = rj.load_campaign({"campaign": campaign, "group": [{"name": "g", "fault": [push]}]})
    faults = {"stop": [push, stop | {"value": 0}], "hold": [push, *hold]}
    groups = [{"name": name, "fault": these} for name, these in faults.items()]
    expected = rj.run({"campaign": campaign, "group": groups}, engine="simd")
    actor = Actor(plain, "simd")
    numbers = np.array([actor.actions[name] for name in expected["group"]])
    lanes = FaultActions(np.zeros(2, int), numbers, *np.full((2, 2), 700))
    ours = actor.run(lanes, np.full(2, 700))
    for column in ("peak_golden_deviation_mm", "tip_path_mm", "largest_step_mm"):
        assert ours[column].tolist() == expected[column].tolist(), column
    assert ours["tip_path_mm"][0] != ours["tip_path_mm"][1]


def test_set_points_move_the_tip_along_a_path(folder):
    """By the forward kinematics of C MuJoCo, and by the length of a straight arm."""
    places = [[0.2, -0.5, -0.1, 0.4], [0.6, -0.4, 0.1, 0.5], [0.9, -0.4, -0.2, 0.3]]
    raw = {"campaign": {"name": "tip", "robot": "arm.xml", "duration_s": 1.0}}
    raw |= {"operator": {"motion": "tip", "tip": places}, "group": [{"name": "free"}]}
    plan = rj.simulate(rj.load_campaign(raw), 0, engine="simd")["jpos_d"].sel(arm="arm").values
    model = mujoco.MjModel.from_xml_path("arm.xml")
    data = mujoco.MjData(model)
    for s, *place in [*places, [0.0, *places[0][1:]], [0.99, *places[-1][1:]]]:
        data.qpos[:] = plan[round(s * 1e3)]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.site("tip").xpos, place, rtol=0, atol=1e-5)
    assert 1e-4 < np.abs(np.diff(plan, axis=0)).max() < 1e-2
    # Poses of a file have one solution near the home position.
    home, poses = model.key_qpos[0], np.zeros((2, 8))
    for pose, s, joints in zip(poses, (0.0, 0.9), (home, home + 0.3), strict=True):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        pose[:4] = s, *data.site("tip").xpos
        mujoco.mju_mat2Quat(pose[4:], data.site("tip").xmat)
    poses[1, 4:] *= -1
    np.savetxt("poses.csv", poses, delimiter=",", header="s,x,y,z,qw,qx,qy,qz")
    raw["operator"] = {"motion": "tip", "file": "poses.csv"}
    plan = rj.simulate(rj.load_campaign(raw), 0, engine="simd")["jpos_d"].sel(arm="arm").values
    np.testing.assert_allclose(plan[[0, 950]], [home, home + 0.3], rtol=0, atol=1e-4)
    # The planar arm reaches 0.6 m far.
    raw["campaign"] |= {"robot": "planar_arm", "duration_s": 0.3}
    raw["operator"] = {"motion": "tip", "tip": [[0, 0.5, 0.2, 0], [0.2, 0.9, 0, 0]]}
    raw["parameters"] = {"kp": 40}
    with pytest.raises(UserError, match=r"\[0.9, 0.0, 0.0\] m at 2\d\d ms: it stays 300 mm away"):
        rj.run(raw)


def test_a_result_belongs_to_one_model(folder, capsys):
    """A file that the model includes counts too; the folder of the files does not."""
    write_campaign(folder / "arm.toml", "arm.xml")
    text = (folder / "arm.xml").read_text()
    (folder / "key.xml").write_text("<mujoco>" + text[text.index("<keyframe") :])
    (folder / "arm.xml").write_text(
        text[: text.index("<keyframe")] + '<include file="key.xml"/></mujoco>'
    )
    words = ["run", "arm.toml", "--out", "a", "--engine", "simd", "--set", "group.0.runs=2"]
    assert main(words) == main(words) == 0
    copy = shutil.copytree(folder, folder / "copy")
    (folder / "arm.xml").unlink()
    assert len(rj.Campaign.from_toml(copy / "arm.toml", ["group.0.runs=2"]).run(engine="simd")) == 2
    shutil.copy(copy / "arm.xml", folder)
    assert main(["run", str(copy / "arm.toml"), *words[2:]]) == 0
    for changed in ("arm.xml", "key.xml"):
        file = copy / changed
        file.write_text(file.read_text().replace("1.5708", "1.5707").replace("8.058", "8.1"))
        capsys.readouterr()
        assert main(["run", str(copy / "arm.toml"), *words[2:]]) == 2
        assert "code:" in capsys.readouterr().err
        shutil.copy(folder / changed, copy)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('<site name="tip" pos="0 0 0.05"/>', "", "expected a site at the tip"),
        (
            '<position name="elbow"',
            '<intvelocity actrange="0 1" name="elbow"',
            "actuator elbow: exp",
        ),
        (
            '<position name="elbow" joint="elbow"',
            '<position name="x" joint="wrist_1"',
            "two actuators",
        ),
        ("<worldbody>", "<worldbody", "XML_ERROR"),
    ],
)
def test_what_an_arm_cannot_have_is_named(folder, old, new, complaint):
    file = folder / "arm.xml"
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(UserError, match=complaint):
        find_robot("arm.xml", folder)
    with pytest.raises(UserError, match=r"no file was found at .*arm2.xml"):
        find_robot("arm2.xml", folder)


def test_a_motor_needs_a_gain(folder, capsys):
    write_campaign(folder / "arm.toml", "planar_arm")
    text = (folder / "arm.toml").read_text()
    (folder / "arm.toml").write_text(text.replace("parameters.kp = 40", ""))
    assert main(["check", "arm.toml", "--trust"]) == 2
    assert "kp.shoulder: expected a gain" in capsys.readouterr().err


@pytest.mark.parametrize("tick_ms", [1, 5])
@pytest.mark.parametrize(
    ("check", "limits", "site", "channel", "value", "ms", "first"),
    [
        # The packet of 600 ms is the first that is lost. At 640 ms, the newest set point is older
        # than 40 ms.
        ("watchdog", {"watchdog": 40}, "packet", "lost", 1, 40, 640),
        ("sensor", {"sensor.elbow": 0.01, "sensor_ms": 5}, "encoder", "elbow", 9, 5, 605),
        # The force of a tick is judged in the next one.
        ("effort", {"effort.elbow": 200, "effort_ms": 5}, "actuator", "elbow", -250, 5, 605),
    ],
)
def test_a_check_stops_an_arm_after_its_time(
    folder, tick_ms, check, limits, site, channel, value, ms, first
):
    set_period(folder / "arm.xml", 1, tick_ms)
    first += tick_ms * (check == "effort")
    fault = {"site": site, "channel": channel, "effect": "overwrite", "value": value}
    fault |= {"start_ms": 600, "duration_ms": [ms, ms + tick_ms]}
    raw = {"campaign": {"name": "arm", "robot": "arm.xml", "duration_s": 1.0}}
    raw |= {"parameters": limits, "group": [{"name": "g", "fault": [fault]}]}
    table = rj.run(raw, engine="simd")
    assert table[f"check_{check}_first_ms"].tolist() == [-1, first]
    assert table["end_runlevel"].tolist() == [1, 0]


@pytest.mark.parametrize("tick_ms", [1, 2, 5])
def test_a_fault_begins_and_ends_at_its_milliseconds(folder, tick_ms):
    set_period(folder / "arm.xml", 1, tick_ms)
    fault = {"site": "encoder", "channel": "elbow", "effect": "drift", "value": 1e-3}
    fault |= {"start_ms": [600, 610], "duration_ms": 20}
    raw = {"campaign": {"name": "arm", "robot": "arm.xml", "duration_s": 1.0, "observe_ms": 100}}
    raw |= {"group": [{"name": "g", "fault": [fault]}]}
    raw["harm"] = [{"name": "late", "when": "always[0:20](time > 700)", "counts": "watch"}]
    table = rj.run(raw, engine="simd")
    assert table["first_active_ms"].tolist() == [600, 610]
    assert table["applied0_last_ms"].tolist() == [620 - tick_ms, 630 - tick_ms]
    assert (table["active_ticks"] * tick_ms == 20).all()
    for column in ("observed_ms", "pedal_down_ms"):
        assert table[column].tolist() == [720, 730]
    assert table["harm_late_first_ms"].tolist() == [-1, 720 + tick_ms]
    run = rj.simulate(raw, 1, engine="simd").sel(arm="arm", joint="elbow")
    assert run["time"][-1] == pytest.approx(0.729)
    off = (
        run["jpos"].values[610:630:tick_ms]
        - run["link_jpos"].values[610 - tick_ms : 630 - tick_ms : tick_ms]
    )
    np.testing.assert_allclose(off, 1e-3 * np.arange(tick_ms, 21, tick_ms), atol=1e-6)


@pytest.mark.parametrize(
    ("section", "times"),
    [
        ("fault", {"start_ms": 401}),
        ("fault", {"duration_ms": {"uniform": [4, 401]}}),
        ("campaign", {"duration_s": 0.401}),
        ("campaign", {"observe_ms": 401}),
        ("harm", {"when": "once[0:401](depth > 2)"}),
    ],
)
def test_a_time_between_two_ticks_is_refused(folder, section, times):
    set_period(folder / "arm.xml", 1, 4)
    fault = {
        "site": "encoder",
        "channel": "elbow",
        "effect": "stuck",
        "start_ms": {"normal": [300, 9]},
    }
    harm = {"name": "deep", "when": "once[0:400](depth > 2)", "counts": "watch"}
    raw = {"campaign": {"name": "arm", "robot": "arm.xml", "duration_s": 1.0}, "fault": fault}
    raw |= {"harm": harm}

    def load():
        group = {"name": "g", "design": "random", "runs": 50, "fault": [raw["fault"]]}
        return rj.load_campaign(
            {"campaign": raw["campaign"], "harm": [raw["harm"]], "group": [group]}
        )

    starts = make_plan(load()).rows["fault0_start_ms"]
    assert (starts % 4 == 0).all() and starts.nunique() > 5
    raw[section] |= times
    with pytest.raises(UserError, match="got 401 ms, expected whole ticks of 4 ms, such as 404 ms"):
        load()


@pytest.mark.parametrize(("step_ms", "tick_ms"), [(3, 5), (0.001, None), (1, 2.5), (1, 0)])
def test_a_period_that_no_arm_can_have_is_refused(folder, step_ms, tick_ms):
    file = folder / "arm.xml"
    set_period(file, step_ms, tick_ms)
    with pytest.raises(UserError, match="expected a period of whole milliseconds"):
        find_robot("arm.xml", folder)


def test_coverage_names_deadlines_only_if_the_robot_declares_actions(folder, capsys):
    (folder / "plain.py").write_text(
        "from pathlib import Path\nfrom ravenjax.robots.mjcf import read_robot\n"
        "from ravenjax.robots.mjcf.campaign import Config, Params, prepare\n"
        "ROBOT = read_robot(Path(__file__).with_name('arm.xml'), __name__, __name__)\n"
    )
    write_campaign(folder / "arm.toml", "arm.xml")
    text = (folder / "arm.toml").read_text().replace("runs = 12", "runs = 1")
    for robot, said in {"plain": "declares no actions", "arm.xml": "`ravenjax deadline`"}.items():
        (folder / "arm.toml").write_text(text.replace("arm.xml", robot))
        words = "--out", robot[:5], "--engine", "simd", "--no-report", "--trust"
        assert main(["run", "arm.toml", *words]) == 0
        capsys.readouterr()
        assert main(["coverage", robot[:5]]) == 0
        assert said in " ".join("".join(capsys.readouterr()).split())

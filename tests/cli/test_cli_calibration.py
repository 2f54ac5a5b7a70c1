"""`ravenjax calibrate`, from a log to a campaign that draws the robots it found."""

from pathlib import Path

import bags
import numpy as np
import pandas as pd
import pytest
import tiny_campaign

from ravenjax import cli
from ravenjax.analyses.calibration import joint_log, parameters, position_loop, replays
from ravenjax.analyses.calibration.parameters import JOINTS
from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

FRICTION, OFFSET = "plant.gold.actuators.coulomb.shoulder", "plant.gold.actuators.bias.shoulder"


def write_log(path: Path, cycles: int, hidden: dict[str, float]) -> bags.Motion:
    """Joints 1-3 of a virtual robot whose unknowns are moved by `hidden` spreads, every 4 ms;
    returns all joints.
    """
    setup = RavenSetup(software="raven2", arms=("gold",))
    seconds = np.arange(cycles)[:, None] * 1e-3
    middle = np.array([0.53, 1.57, 0.40, 0.0, 0.0, 0.78, 0.78])
    sweep = np.array([0.12, 0.12, 0.01, 0.0, 0.0, 0.0, 0.0])
    desired = middle + sweep * np.sin(
        2.0 * np.pi * np.array([0.41, 0.53, 0.47, 0.0, 0.0, 0.0, 0.0]) * seconds
    )
    wanted = parameters.select_unknowns(range(3), ("friction", "offsets"))
    steps = np.array([hidden.get(one.path, 0.0) for one in wanted])
    base = position_loop.params(robot.params(setup, "gold", "power_consistent"))
    every_cycle = joint_log.JointLog(
        desired[0], desired, np.full((cycles, 7), np.nan), np.arange(cycles)
    )
    replay_setup = replays.setup_of(setup, "gold", position_loop.RAVEN2, wanted)
    (joints,) = replays.replay_robots(
        replay_setup, [parameters.apply_steps(base, wanted, steps)], every_cycle
    )
    before = np.vstack([desired[:1], joints[:-1]])  # a row is read before its cycle's command
    table = {"time_s": seconds[::4, 0]}
    for j, word in enumerate(JOINTS[:3]):
        table |= {f"jpos_d_{word}": desired[::4, j], f"jpos_{word}": before[::4, j]}
    pd.DataFrame(table).to_parquet(path)
    return bags.Motion(seconds[::4, 0], desired[::4], before[::4])


def assert_same_log(table: Path, bag: Path) -> None:
    """Joints 1-3 of both."""
    one, other = (
        joint_log.read_joint_log(path, "gold", "r_grasper", "raven2", position_loop.RAVEN2)
        for path in (table, bag)
    )
    assert one.cycles.tolist() == other.cycles.tolist()
    for name in ("desired", "measured"):
        np.testing.assert_allclose(
            getattr(one, name)[:, :3], getattr(other, name)[:, :3], rtol=0.0, atol=1e-6
        )


@pytest.mark.slow
def test_a_log_becomes_robots_that_a_campaign_draws(tmp_path, capsys) -> None:
    log, file = tmp_path / "log.parquet", tmp_path / "my_robot.toml"
    motion = write_log(log, 8000, {"dry_friction.shoulder": 0.5, "offset.shoulder": -0.6})
    assert_same_log(log, bags.state_bag(tmp_path / "log.bag", motion, motion))
    assert cli.main(["calibrate", str(log), "--out", str(file), "--draws", "40"]) == 0
    assert "which was not fitted" in capsys.readouterr().out
    for name in ("my_robot.svg", "my_robot_parameters.svg"):
        assert (tmp_path / name).stat().st_size > 10_000
    raw = tiny_campaign.tables(runs=203)
    raw["group"], raw["parameters"] = raw["group"][1:], {"from": file.name}
    rows = design.table_columns(loading.from_dict(raw, source=tmp_path / "campaign.toml"))
    base = robot.params(RavenSetup(software="raven2", arms=("gold",)), "gold", "power_consistent")
    friction, offset = (rows[f"param:{path}"] for path in (FRICTION, OFFSET))
    assert friction.nunique() > 30
    others = ("usb.command_delay", "plant.gold.cable_stiffness.elbow")
    for path in (*others, "plant.gold.actuators.gain.insertion"):
        assert rows[f"param:{path}"].notna().all()
    hidden = float(base.actuators.coulomb[0]) * np.exp(0.6 * 0.5)
    assert friction.median() == pytest.approx(hidden, rel=0.05)
    assert offset.median() == pytest.approx(float(base.actuators.bias[0]) - 0.6 * 0.02, abs=0.002)


def test_a_log_that_is_too_short_is_refused(tmp_path, capsys) -> None:
    table = {"time_s": np.arange(100) * 1e-3}
    table |= {f"{name}_shoulder": np.full(100, 0.5) for name in ("jpos", "jpos_d")}
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    words = ["calibrate", str(tmp_path / "log.csv"), "--out", str(tmp_path / "robot.toml")]
    assert cli.main(words) == 2
    assert "the log lasts 0.1 s, expected at least 4 s" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "robot.toml").exists()

"""What `ravenjax check` says of a campaign is what a run would do, and nothing is computed."""

import pytest
import tiny_campaign as tiny

from ravenjax.campaign import loading, plan, runner
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.inspection import estimate, preview


@pytest.fixture
def idle(monkeypatch):
    """Whoever computes fails."""

    def computed(*_):
        raise AssertionError("something was computed")

    monkeypatch.setattr(Computation, "__init__", computed)


def view_of(config, folder, engine="auto"):
    return preview.preview_campaign(config, folder, engine)[0]


@pytest.mark.parametrize("name", ["quick.toml", "safecomp45.toml"])
def test_the_numbers_are_those_of_the_fault_table(name, idle, tmp_path):
    config = loading.load_campaign(name)
    (view, sample), ready = (
        preview.preview_campaign(config, tmp_path / "out"),
        plan.make_plan(config),
    )
    rows = ready.rows
    assert view["runs"] == view["runs_asked_for"] == len(rows)
    assert {row["name"]: row["runs"] for row in view["groups"]} == rows["group"].value_counts(
        sort=False
    ).to_dict()
    slots = range(config.slots)
    struck = {(row["site"], row["effect"]): row["runs"] for row in view["faults"]}
    for (site, effect), runs in struck.items():
        hit = [
            (rows[f"fault{s}_site"] == site) & (rows[f"fault{s}_effect"] == effect) for s in slots
        ]
        assert runs == sum(any(one) for one in zip(*hit, strict=True))
    sites = {site for s in slots for site in rows[f"fault{s}_site"].unique()} - {""}
    assert {site for site, _ in struck} == sites
    assert view["fault_free_runs"] == sum(
        all(row == "") for row in rows[[f"fault{s}_site" for s in slots]].to_numpy()
    )
    assert view["golden_runs"] == len(set(ready.golden.tolist()))
    indices = sample["index"].tolist()
    assert indices == sorted(set(indices)) and len(sample) == preview.SAMPLE
    assert sample["run_id"].tolist() == [f"{int(rows['run_id'].iloc[i]):016x}" for i in indices]
    assert not (tmp_path / "out").exists(), "nothing is written"


def test_a_limit_asks_for_less_of_the_same(idle, tmp_path):
    view = view_of(loading.load_campaign("quick.toml", ["campaign.limit=64"]), tmp_path)
    whole = view_of(loading.load_campaign("quick.toml"), tmp_path)
    assert (view["runs"], view["runs_asked_for"]) == (2571, 64)
    assert view["expected"]["run_s"] < whole["expected"]["run_s"]


@pytest.mark.parametrize(("noise", "copies"), [(False, 1), (True, 0)])
def test_runs_that_repeat_another_are_counted(idle, tmp_path, noise, copies):
    fault = {"site": "usb_out", "channel": "elbow", "effect": "overwrite", "start_ms": 5}
    groups = [
        {"name": str(values), "fault": [{**fault, "value": values}]} for values in ([1, 2], [2, 3])
    ]
    raw = {"campaign": {"name": "x", "duration_s": 0.02, "noise": noise}, "group": groups}
    assert view_of(loading.from_dict(raw), tmp_path)["copies"] == copies


@pytest.mark.slow
def test_a_folder_that_holds_a_part_says_how_fast_it_was(tmp_path):
    config = tiny.config()
    few = config.model_copy(update={"campaign": config.campaign.model_copy(update={"limit": 100})})
    runner.run_campaign(few, tmp_path, "simd")
    view = view_of(config, tmp_path, "simd")
    assert view["folder"]["holds"].startswith("100 of 300 runs of campaign tiny")
    basis = view["expected"]["basis"]
    assert basis.endswith("200 of 300 runs left")
    assert "measured at the folder's last start" in basis
    assert view_of(few, tmp_path, "simd")["expected"]["run_s"] == 0.0
    other = view_of(loading.load_campaign("quick.toml"), tmp_path, "simd")
    assert other["expected"]["basis"] == estimate.BASIS, "another campaign says nothing of this one"


def test_it_tells_what_a_check_of_ones_own_does(command_line, idle, tmp_path):
    """Numbers are those of its file: of its parameters too, which the file alone names."""
    (tmp_path / "gate.py").write_text(GATE)
    campaign = tmp_path / "own.toml"
    campaign.write_text(OWN)
    arguments = ("check", str(campaign), "--out", str(tmp_path / "out"))
    code, _, err = command_line(*arguments)
    assert code == 2 and "gate.py: this Python file was not run" in err and "--trust" in err
    code, out, err = command_line(*arguments, "--trust")
    assert code == 0, err
    lines = {what: text for what, _, text in (line.partition("│") for line in out.splitlines())}
    lines = {what.strip(): text.strip() for what, text in lines.items()}
    assert (
        lines["check gate"]
        == "at usb_out, above 0.25 to 4, varied: stops the robot; checks.own.gate.counts = 3000"
    )
    (tmp_path / "gate.py").write_text(GATE.replace("view.boards_cmd", "view.bords_cmd"))
    code, out, err = command_line(*arguments, "--trust")
    assert code == 2 and "view has no bords_cmd at usb_out; it has" in err and "boards_cmd" in err


GATE = """
from ravenjax.parts import Annotated, Quantity, Scalar, record

@record
class Gate:
    counts: Annotated[Scalar, Quantity("DAC counts", 1, 65535, "command at which the score is 1")]

def params():
    return Gate(3000.0)

def step(params, state, view):
    return state, view.boards_cmd[0] / params.counts
"""
OWN = """
[campaign]
name = "own"
duration_s = 1.0
[operator]
motion = "suture"
[[check]]
name = "gate"
file = "gate.py"
at = "usb_out"
acts = "stop"
[[group]]
name = "free"
[group.cross]
"checks.threshold.gate" = [0.25, 1, 4]
"""

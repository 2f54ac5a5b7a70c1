"""The command line: help is fast, errors are one message and code 2, lists are complete."""

import json
import subprocess
import sys

import pytest

from ravenjax.robots.raven2.declaration import SITES
from ravenjax.vocabulary.effects import EFFECTS


def test_help_and_version_import_nothing_slow():
    code = (
        "import sys; from ravenjax.cli import main; main(['--help']); main(['--version']);slow ="
        " {'jax', 'mujoco', 'pandas', 'scipy', 'pydantic'} & set(sys.modules);"
        " sys.exit(len(slow))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    commands = "run fault-free check report trace verify merge motion train robot study campaigns"
    for command in f"{commands} faults parameters doctor --trust".split():
        assert command in done.stdout


@pytest.mark.parametrize(
    "tokens, parts",
    [
        (["run", "."], [".: is a folder, expected a campaign file"]),
        (["run", "quick.toml", "--chunk", "0"], ['Invalid value "0" for --chunk']),
        (["train", "first_steps", "--no-page"], ["nobody moves the robot: add --page, --script"]),
        (["rn"], ['Did you mean "run"']),
        (["faults", "usb_ou"], ["unknown word 'usb_ou', expected a layer", "'usb_out'?"]),
        (["check", "a\udcff.toml"], ["is not UTF-8; rename the file or folder"]),
    ],
)
def test_user_errors_are_messages_with_code_2(command_line, tokens, parts):
    code, out, err = command_line(*tokens)
    assert code == 2
    for part in parts:
        assert part in err or part in out
    assert "Traceback" not in err + out


def test_parameters_are_listed_with_their_ranges(command_line):
    options = ("--set", 'campaign.arms=["gold", "green"]', "campaign.software=fork2015")
    code, out, _ = command_line("parameters", *options)
    assert code == 0
    lines = {line.split("│")[0].strip(): line for line in out.splitlines() if "│" in line}
    assert "0..100" in lines["plant.green.friction_scale"]
    assert "1..1000 cycles, whole" in lines["network.cycles_per_packet"]
    assert not [path for path in lines if "noise_key" in path or path.startswith("start")]


def test_a_page_of_a_campaign_with_noise_is_refused(command_line, tmp_path):
    file, page = tmp_path / "noisy.toml", tmp_path / "page.html"
    file.write_text(
        "[campaign]\nname = 'noisy'\nduration_s = 0.2\nnoise = true\n[operator]\nmotion = 'still'\n"
        "[[group]]\nname = 'a'\n[group.parameters]\nplant.gold.encoder_noise = 2\n"
    )
    code, _, err = command_line("explore", file, "-o", page)
    assert code == 2 and "set campaign.noise to false" in err and not page.exists()


def test_interrupt_says_how_to_go_on(command_line, monkeypatch):
    from ravenjax.campaign import loading

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(loading, "load_campaign", interrupted)
    code, _, err = command_line("run", "quick.toml")
    assert code == 130 and "same command continues" in err


def as_json(command_line, *tokens):
    """(code, value) of a command line with --json: nothing but JSON is on standard output."""
    code, out, _ = command_line(*tokens, "--json")
    return code, json.loads(out)


def test_faults_as_json(command_line):
    _, told = as_json(command_line, "faults")
    assert [one["site"] for one in told["sites"]] == list(SITES)
    assert {one["effect"] for one in told["effects"]} == set(EFFECTS)
    _, told = as_json(command_line, "faults", "usb_out")
    assert told["site"][0]["value"].startswith("L7: ")
    assert told["channels"][0]["type_of_number"] == "int16"
    of_network = {"drop", "lose", "duplicate", "delay"}
    assert {one["effect"] for one in told["effects"]} == set(EFFECTS) - of_network
    assert [one["id"] for one in told["hazards"]] == ["B11", "B24", "B25", "B26", "B27"]
    assert as_json(command_line, "faults", "parameter")[1]["channels"][0]["channel"] == "PATH"
    _, told = as_json(command_line, "faults", "--robot", "planar_arm", "--trust")
    assert [one["site"] for one in told["sites"]][:3] == ["parameter", "packet", "encoder"]
    assert "hazards" not in told
    _, told = as_json(command_line, "faults", "encoder", "--robot", "planar_arm", "--trust")
    assert told["channels"][1]["range_without_a_fault"] == "-2.5..2.5"
    _, told = as_json(command_line, "parameters", "--robot", "planar_arm", "--trust")
    assert "kp" in [one["path"] for one in told["parameters"]]
    _, told = as_json(command_line, "faults", "C09")
    assert told["hazard"][0] == {"property": "id", "value": "C09"}
    _, told = as_json(command_line, "faults", "brake")
    engaged = {"channel": "engaged", "type_of_number": "bool", "unit": "1"}
    assert told["channels"] == [engaged | {"range_without_a_fault": "0..1"}]


def test_doctor_as_json(command_line):
    code, told = as_json(command_line, "doctor")
    assert {"test": "jax computes", "state": "ok"}.items() <= told["works"][0].items()
    assert "python" in {one["property"] for one in told["machine"]}
    assert code == int(any(one["state"] != "ok" for one in told["works"]))

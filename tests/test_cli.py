"""The command line: help is fast, errors are one message and code 2, lists are complete."""

import subprocess
import sys
import time

import pytest

from ravenjax.cli import console, main
from ravenjax.robot.sites import SITES
from ravenjax.stages.faults.vocabulary import EFFECTS, TRIGGERS


@pytest.fixture
def run(capsys, monkeypatch):
    """(code, stdout, stderr) of a command line, on a wide terminal."""
    monkeypatch.setattr(console, "out", type(console.out)(width=400))
    monkeypatch.setattr(console, "err", type(console.err)(width=400, stderr=True))

    def run(*tokens):
        code = main(list(tokens))
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


def test_help_and_version_are_fast_and_import_nothing_slow():
    code = (
        "import sys; from ravenjax.cli import main; main(['--help']); main(['--version']);"
        "slow = {'jax', 'mujoco', 'pandas', 'scipy', 'plotly', 'pydantic'} & set(sys.modules); sys.exit(len(slow))"
    )
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert time.perf_counter() - begin < 2.0  # 0.2 s alone; the machine may be busy
    for command in (
        "run",
        "report",
        "trace",
        "verify",
        "merge",
        "train",
        "robot",
        "study",
        "campaigns",
        "faults",
        "parameters",
        "doctor",
    ):
        assert command in done.stdout


def test_faults_lists_every_word(run):
    code, out, _ = run("faults")
    assert code == 0
    words = out.split()
    for word in (*SITES, *EFFECTS, *TRIGGERS):
        assert word in words, word


def test_campaigns_lists_the_bundled_ones_with_their_runs(run):
    code, out, _ = run("campaigns")
    assert code == 0
    assert "quick.toml" in out and "2571" in out and "seed_burst.toml" in out


@pytest.mark.parametrize(
    "tokens, parts",
    [
        (["run", "quik.toml"], ["quik.toml: no such campaign file", "Did you mean 'quick'"]),
        (["run", "quik"], ["`ravenjax campaigns` lists", "Did you mean 'quick'"]),
        (["run", "."], [".: is a folder, expected a campaign file"]),
        (["run", "quick", "--set", "campaign.sed=1"], ["campaign.sed: unknown key"]),
        (["parameters", "--set", "parameters.plant.mass_scale=0"], ["got 0, expected 0.01..100"]),
        (["bench", "--markdown", "nowhere/at/all.md"], ["--markdown nowhere/at/all.md", "folder does not exist"]),
        (["run", "quick.toml", "--set", "campaign.sed=1"], ["--set: campaign.sed: unknown key", "Did you mean 'seed'"]),
        (["run", "quick.toml", "--chunk", "0"], ["--set: campaign.chunk: got 0"]),
        (["rn"], ['Did you mean "run"']),
        (["run"], ["requires an argument"]),
    ],
)
def test_user_errors_are_messages_with_code_2(run, tokens, parts):
    code, out, err = run(*tokens)
    assert code == 2
    for part in parts:
        assert part in err or part in out
    assert "Traceback" not in err + out


def test_parameters_are_listed_with_their_ranges(run):
    code, out, _ = run("parameters", "--set", 'campaign.arms=["gold", "green"]', "--set", "campaign.software=fork2015")
    assert code == 0
    lines = {line.split("│")[0].strip(): line for line in out.splitlines() if "│" in line}
    assert (
        "0..100" in lines["plant.green.friction_scale"]
        and "1..1000 cycles, whole" in lines["network.cycles_per_packet"]
    )
    assert not [path for path in lines if "noise_key" in path or path.startswith("start")]


def test_names_stay_whole_on_a_narrow_terminal(capsys, monkeypatch):
    monkeypatch.setattr(console, "out", type(console.out)(width=70))
    assert main(["parameters"]) == 0
    assert "plant.gold.actuators.torque_per_count" in capsys.readouterr().out


def test_a_bug_is_not_hidden(monkeypatch):
    from ravenjax.campaign import loading

    def broken(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(loading, "load", broken)
    with pytest.raises(ZeroDivisionError):
        main(["run", "quick.toml"])


def test_interrupt_says_how_to_go_on(run, monkeypatch):
    from ravenjax.campaign import loading

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(loading, "load", interrupted)
    code, _, err = run("run", "quick.toml")
    assert code == 130 and "same command goes on" in err


def test_doctor(run):
    code, out, _ = run("doctor")
    assert "jax computes" in out and "cpu:0" in out
    assert code == int("FAILED" in out)


def test_report_of_a_folder_without_results(run, tmp_path):
    code, _, err = run("report", str(tmp_path))
    assert code == 2 and str(tmp_path) in err

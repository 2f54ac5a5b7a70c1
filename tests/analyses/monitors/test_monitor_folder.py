"""A monitor from its calibration to C: the folder, its bits, what fresh operations say of it,
and bad input.
"""

import csv
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import ravenjax as rj
from ravenjax import cli
from ravenjax.analyses.monitors import calibration, checking, code, score_folder, writing
from ravenjax.analyses.monitors.monitor import Monitor, Segments, split_scores
from ravenjax.analyses.monitors.scores import list_candidates
from ravenjax.errors import StoreError, UserError
from ravenjax.robots.raven2 import ROBOT
from ravenjax.stats.conformal import threshold

CAMPAIGN = """
[campaign]
name = "robots"
noise = true
arms = ["gold", "green"]
[operator]
motion = "suture"
[parameters]
plant.friction_scale = { loguniform = [0.7, 1.4] }
plant.encoder_noise = 1
[[group]]
name = "healthy"
design = "random"
runs = 2
"""
RATE = ("--false-alarms-per-hour", "150", "--confidence", "0.5")
SCORES = ("tip_error_bound", "boards_cmd_rate", "jpos_residual_model_jpos")
SIGNALS = ("--hours", "0.0534", "--signals", *SCORES, "--segments", "tick=800")  # 32 operators


def command(*words: object) -> int:
    return cli.main(list(map(str, words)))


def calibrate(place: Path, out: Path, *words: object) -> int:
    """Exit code of a calibration of the campaign in `place`."""
    design = (*RATE, "--length-s", "3", "--robots", "2")
    return command("monitor", "calibrate", place / "robots.toml", "--out", out, *design, *words)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("monitor")
    (place / "robots.toml").write_text(CAMPAIGN)
    assert calibrate(place, place / "m", *SIGNALS) == 0
    return place / "m"


@pytest.fixture(scope="module")
def one_arm(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder as if its scores were of the first arm alone, so that logs can be checked."""
    place = tmp_path_factory.mktemp("one_arm") / "m"
    shutil.copytree(folder, place)
    path = place / writing.RECORD
    path.write_text(path.read_text().replace('arms = ["gold", "green"]', 'arms = ["gold"]'))
    return place


@pytest.fixture(scope="module")
def compiler() -> str:
    found = shutil.which("cc")
    if found is None:
        pytest.skip("no C compiler here")
    return found


def compiled(
    compiler: str, folder: Path, out: Path, *options: str
) -> subprocess.CompletedProcess[str]:
    """The folder's C, compiled without a warning and run over its test vector."""
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", *options]
    sources = [str(folder / name) for name in (code.SOURCE, code.TEST)]
    subprocess.run([compiler, *strict, *sources, "-lm", "-o", str(out)], check=True)
    return subprocess.run([str(out), str(folder / writing.VECTOR)], capture_output=True, text=True)


@pytest.mark.parametrize("options", [["-O0"], ["-O3", "-march=native"]])
def test_c_gives_the_bits_of_the_tick(folder, compiler, tmp_path, options):
    result = compiled(compiler, folder, tmp_path / "a.out", *options)
    assert result.returncode == 0, result.stdout
    rows = list(csv.DictReader((folder / writing.VECTOR).open()))
    alarms = sum(row["alarm"] == "1" for row in rows)
    assert (
        result.stdout == f"3000 milliseconds, {alarms} in alarm, 0 differ\n" and 0 < alarms < 2000
    )
    assert {row["live"] for row in rows} == {"0", "1"} and all(
        row["score"] == "0" for row in rows if row["live"] == "0"
    )


@pytest.mark.parametrize(
    "kind",
    ["rate", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("bound", "residual"))],
)
def test_every_kind_of_score_gives_the_same_bits_in_c(compiler, tmp_path, kind):
    """All candidates of a kind at once, scales of all sizes."""
    scores = split_scores([score for score in list_candidates(ROBOT) if score.kind == kind])
    rng, segments = np.random.default_rng(1), Segments("tick", (700.0, 1600.0))
    scales = np.exp(rng.normal(0, 4, (len(scores), 3))).astype(np.float32)
    monitor = Monitor(scores, segments, tuple(tuple(map(float, row)) for row in scales), 3.0)
    config = rj.load_campaign(
        {"campaign": {"name": "a"}, "operator": {"motion": "reach"}, "group": [{"name": "f"}]}
    )
    vector = writing.compute_test_vector(config, monitor, 2)
    assert np.isfinite(vector["score"]).all() and vector["score"].nunique() > 100
    for name, text in code.write_c(monitor, ["a"]).items():
        (tmp_path / name).write_text(text)
    (tmp_path / writing.VECTOR).write_text(writing._csv(vector))
    assert compiled(compiler, tmp_path, tmp_path / "a.out").stdout.endswith(" 0 differ\n")


def test_the_record_says_what_the_promise_rests_on(folder):
    monitor, record = writing.read_monitor(folder)
    assert (
        record["promise"]["false_alarms_per_hour"] == 150 and record["promise"]["confidence"] == 0.5
    )
    peaks = score_folder.read_scores(folder / score_folder.FOLDER)
    uses = calibration.assign_uses(peaks.unit)
    assert record["calibration"]["units"] == len(set(peaks.unit[uses.threshold])) > 0
    assert (
        record["calibration"]["operations"]
        == uses.threshold.sum()
        == 2 * record["calibration"]["units"]
    )
    assert (
        not (uses.scale & uses.threshold).any() and (uses.scale | uses.threshold | uses.test).all()
    )
    score = threshold.joint_scores(peaks.score, np.array(monitor.scales))
    assert (
        record["calibration"]["alarms"]
        == (score[uses.threshold] > np.float32(monitor.threshold)).sum()
    )
    assert record["test"]["alarms"] == (score[uses.test] > np.float32(monitor.threshold)).sum()
    quiet = uses.test & (score <= np.float32(monitor.threshold))
    assert record["test"]["hours"] == pytest.approx(peaks.hours[quiet].sum(), rel=1e-6)
    assert record["test"]["alarms_per_hour"] == pytest.approx(
        record["test"]["alarms"] / record["test"]["hours"]
    )
    assert monitor.segments == Segments("tick", (800.0,)) and len(monitor.terms) == 7
    assert tomllib.loads((folder / "monitor.toml").read_text())["term"][0]["alarm_above"]


@pytest.mark.slow
def test_a_calibration_goes_on_and_changes_nothing(folder, tmp_path):
    other = tmp_path / "m"
    shutil.copytree(folder, other)
    parts = sorted((other / score_folder.FOLDER / score_folder.PARTS).iterdir())
    before = pq.read_table(parts[0])
    for part in parts[:3]:
        part.unlink()
    assert calibrate(folder.parent, other, *SIGNALS) == 0
    assert pq.read_table(parts[0]).equals(before)
    for name in (writing.RECORD, code.PART, writing.VECTOR, writing.REFERENCE):
        assert (folder / name).read_text() == (other / name).read_text()


@pytest.mark.slow
def test_a_shifted_robot_is_reported_and_a_like_one_is_not(folder, tmp_path, capsys):
    for name, changes, status in (
        ("like", [], 0),
        (
            "shifted",
            ["--set", "parameters.plant.friction_scale=6", "parameters.plant.encoder_noise=12"],
            1,
        ),
    ):
        out = tmp_path / name
        hours = ("--hours", 0.0184, "--robots", 1)
        assert command("monitor", "operate", folder, "--out", out, *hours, *changes) == 0
        capsys.readouterr()
        assert command("monitor", "check", folder, out, "--json") == status
        result = json.loads(capsys.readouterr().out)
        assert result["shifted"] == bool(status) and result["units"] == 22
    assert max(one["place"] for one in result["signals"]) > 0.9


@pytest.mark.slow
def test_results_and_logs_are_checked(one_arm, tmp_path, capsys):
    folder = one_arm
    monitor, _ = writing.read_monitor(folder)
    raw = tomllib.loads(CAMPAIGN)
    raw["campaign"] |= {"duration_s": 3.0, "seed": 9}
    raw["detector"] = [{"name": "mine", "file": str(folder / code.PART), "consecutive": [4, 1]}]
    rj.run(raw, tmp_path / "result", engine="simd")
    assert checking.check_exchangeability(folder, [tmp_path / "result"]).attrs["units"] == 1
    log = tmp_path / "log.csv"
    lines = (folder / writing.VECTOR).read_text().splitlines(keepends=True)
    log.write_text("".join(lines))
    result = checking.check_exchangeability(folder, [log])
    for twice in (log, tmp_path / "result"):
        with pytest.raises(UserError, match="Check the two sources separately"):
            checking.check_exchangeability(folder, [twice, twice])
    assert result.attrs["units"] == 1 and set(result["score"]) > {"score"}
    rows = list(csv.DictReader(lines))
    peak = checking.series_scores(
        monitor,
        np.array([row["live"] == "1" for row in rows]),
        {name: np.array([row[name] for row in rows], np.float32) for name in rows[0]},
    )
    joint = (peak.reshape(-1, 2) / np.array(monitor.scales, np.float32)).max()
    assert joint == max(np.float32(row["score"]) for row in rows)


def _log(change):
    def made(folder: Path, place: Path) -> Path:
        lines = (folder / writing.VECTOR).read_text().splitlines(keepends=True)
        (place / "log.csv").write_text("".join(change(lines)))
        return place / "log.csv"

    return made


BAD_SOURCES = {
    "nothing": (
        lambda folder, place: place / "none",
        r"none: expected a folder of `ravenjax monitor operate`",
    ),
    "itself": (lambda folder, place: folder, "has the operators of the calibration"),
    "short": (
        _log(lambda lines: lines[:500]),
        r"lasts 499 ms, but the calibration's operations last 3000 ms",
    ),
    "text": (
        _log(lambda lines: [*lines[:7], lines[7].replace("0,", "zero,", 1), *lines[8:]]),
        "line 8: expected a number",
    ),
}


@pytest.mark.parametrize("case", BAD_SOURCES)
def test_what_cannot_be_compared_is_refused(one_arm, tmp_path, case):
    make, message = BAD_SOURCES[case]
    with pytest.raises(UserError, match=message):
        checking.check_exchangeability(one_arm, [make(one_arm, tmp_path)])


def test_a_log_of_one_arm_is_not_compared_with_two(folder):
    with pytest.raises(UserError, match=r"the log has one arm, .* the arms gold and green"):
        checking.check_exchangeability(folder, [folder / writing.VECTOR])


def test_a_changed_file_is_refused(folder, tmp_path):
    other = tmp_path / "m"
    shutil.copytree(folder, other)
    path = other / code.SOURCE
    path.write_text(path.read_text().replace("score = 0.0f", "score = 1.0f"))
    with pytest.raises(StoreError, match=r"monitor\.c: was changed after the calibration"):
        writing.read_monitor(other)
    with pytest.raises(StoreError, match=r"none/monitor\.toml: cannot be read"):
        writing.read_monitor(tmp_path / "none")


BAD_OPTIONS = {
    "signal": (
        ["--signals", "tip_eror_bound"],
        "Raven-II has no signal of this name; .* Did you mean 'tip_error_bound'",
    ),
    "segments": (
        ["--segments", "tick=5,3"],
        "expected the name of a signal and ascending numbers, such as tick=1000,5000",
    ),
    "hours": (["--hours", "0.001"], r"--hours \d+ or more, or --robots 1 --hours"),
    "motion": (
        ["--motions", "stil"],
        r"unknown motion 'stil', expected one of suture, .* Did you mean 'still'",
    ),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_bad_options_are_one_error(folder, tmp_path, capsys, case):
    options, message = BAD_OPTIONS[case]
    status = calibrate(folder.parent, tmp_path / "m", *options)
    captured = capsys.readouterr()
    assert status == 2 and re.search(message, captured.err.replace("\n", " "))


def test_another_campaign_does_not_go_on_in_the_folder(folder, tmp_path, capsys):
    other = tmp_path / "m"
    shutil.copytree(folder, other)
    status = calibrate(folder.parent, other, *SIGNALS, "--seed", 3)
    assert (
        status == 2
        and "contains operations with another design" in capsys.readouterr().err.replace("\n", " ")
    )

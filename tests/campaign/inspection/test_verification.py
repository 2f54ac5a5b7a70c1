"""A folder is believed where all is as it must be; each kind of damage is found, and runs made
again are the same.
"""

import shutil

import numpy as np
import pandas as pd
import pytest
from synthetic_results import write_part

import ravenjax as rj
from ravenjax.campaign import runner
from ravenjax.campaign.inspection import verification
from ravenjax.cli import results
from ravenjax.store import manifest as manifests
from ravenjax.store import parts
from ravenjax.store.folder import read_all

CAMPAIGN = {
    "campaign": {"name": "tiny", "duration_s": 0.3, "seed": 3, "chunk": 10},
    "operator": {"motion": "reach"},
    "group": [
        {"name": "free"},
        {
            "name": "dac",
            "design": "random",
            "runs": 39,
            "fault": [
                {
                    "site": "usb_out",
                    "channel": ["shoulder", "elbow"],
                    "effect": "overwrite",
                    "value": {"uniform": [-9000, 9000]},
                    "start_ms": {"uniform": [150, 200]},
                    "duration_ms": {"uniform": [1, 90]},
                }
            ],
        },
    ],
}


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    path = tmp_path_factory.mktemp("verified") / "tiny"
    runner.run_campaign(rj.load_campaign(CAMPAIGN), path, "simd")
    return path


@pytest.fixture
def folder(computed, tmp_path):
    return shutil.copytree(computed, tmp_path / "tiny")


def wrong(found):
    return {check.name: check.problems for check in found.checks if check.problems}


def rewritten(folder, change, place=1):
    """Part number `place` with changed rows, recorded as if a campaign had written it."""
    record = manifests.read_manifest(folder)
    part = record.parts[place]
    frame = read_all(folder).iloc[part.first : part.last + 1].reset_index(drop=True)
    frame = pd.DataFrame({name: np.array(frame[name]) for name in frame})
    change(frame)
    (folder / "parts" / part.file).unlink()
    new = write_part(folder / "parts", frame, record.shape, record.config_hash)
    listed = (*record.parts[:place], new, *record.parts[place + 1 :])
    manifests.write_manifest(folder, record.model_copy(update={"parts": listed}))


def test_runs_made_again_are_equal_to_the_bit(folder):
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    found = verification.verify_folder(folder, sample=12)
    assert found.fine and found.rerun is not None and found.rerun.changes == []
    assert (
        len(set(found.rerun.rows.tolist())) == found.rerun.verdicts == 12
        and found.rerun.differing == []
    )
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_one_changed_number_is_found_by_running_it_again(folder):
    def change(frame):
        frame.loc[3, "tip_path_mm"] = np.nextafter(frame.loc[3, "tip_path_mm"], np.float32(9e9))

    rewritten(folder, change)
    assert wrong(verification.verify_folder(folder, sample=0)) == {}
    found = verification.verify_folder(folder, sample=99)
    assert wrong(found) == {"recomputed runs": ["tip_path_mm: differs in 1 of 40 rows"]}


def test_other_code_is_told_and_excuses_outcomes_not_inputs(folder):
    def change(frame):
        frame.loc[3, "tip_path_mm"] += 1
        frame.loc[3, "fault0_value"] += 1

    rewritten(folder, change)
    record = manifests.read_manifest(folder)
    manifests.write_manifest(folder, record.model_copy(update={"code_hash": "f" * 64}))
    found = verification.verify_folder(folder, sample=99)
    assert found.rerun is not None and found.rerun.changes == ["another version of the code"]
    apart = {one.name: one.largest for one in found.rerun.differing}
    assert apart == {"tip_path_mm": pytest.approx(1, abs=1e-4), "fault0_value": pytest.approx(1)}
    assert wrong(found) == {"recomputed runs": ["fault0_value: differs in 1 of 40 rows"]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("column", "value", "check", "told"),
    [
        (
            "response_ms",
            999_999,
            "ranges",
            "response_ms: is outside -1 to 300 ms in 1 run, first in run 13",
        ),
        (
            "unintended_mm",
            np.inf,
            "finite numbers",
            "unintended_mm: is not finite in 1 run, first in run 13",
        ),
        (
            "verdict",
            "stopped/none/cue",
            "verdicts",
            "verdict: does not follow from response, hazard and cue in 1 run",
        ),
        (
            "run_id",
            "f" * 16,
            "campaign",
            "its run ids are not those of the campaign's rows 10 to 19",
        ),
    ],
)
def test_a_value_that_cannot_be_is_told_with_its_row(folder, column, value, check, told):
    def change(frame):
        frame[column] = frame[column].astype(object)
        frame.loc[3, column] = value

    rewritten(folder, change)
    problems = wrong(verification.verify_folder(folder, sample=0))
    assert any(told in problem for problem in problems[check])


def test_damaged_missing_and_stray_parts_are_each_named(folder):
    files = parts.part_files(folder / "parts")
    files[0].write_bytes(files[0].read_bytes()[:-50])
    files[1].unlink()
    shutil.copy(files[2], folder / "parts" / "part-000000025-000000034.parquet")
    problems = wrong(verification.verify_folder(folder, sample=0))["parts"]
    assert [problem.partition(":")[0].rpartition("/")[2] for problem in problems] == [
        files[0].name,
        files[1].name,
        "part-000000025-000000034.parquet",
    ]


def test_the_command_ends_with_code_1_where_something_is_wrong(folder, capsys):
    assert results.verify(folder, sample=3) == 0
    path = parts.part_files(folder / "parts")[0]
    path.write_bytes(path.read_bytes()[:-50])
    assert results.verify(folder, sample=0) == 1
    told = capsys.readouterr()
    assert "WRONG" in told.out and path.name in told.err


def test_missing_and_double_rows(folder):
    record, frame = manifests.read_manifest(folder), read_all(folder)
    manifests.write_manifest(
        folder, record.model_copy(update={"parts": (*record.parts[:1], *record.parts[2:])})
    )
    problems = wrong(verification.verify_folder(folder, sample=0))
    assert (
        problems["rows"] == ["10 rows are missing: 10 to 19"]
        and "does not list this file" in problems["parts"][0]
    )
    double = write_part(folder / "parts", frame.iloc[2:5], record.shape, record.config_hash)
    manifests.write_manifest(folder, record.model_copy(update={"parts": (*record.parts, double)}))
    (problem,) = wrong(verification.verify_folder(folder, sample=0))["rows"]
    assert double.file in problem and "another file contains" in problem

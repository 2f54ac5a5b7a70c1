"""`ravenjax explain`: what it prints and writes, and one clear error for each thing that cannot
be explained.
"""

import csv
import json
from typing import Any

import pandas as pd
import pytest
import tiny_campaign

import ravenjax as rj
from ravenjax import cli
from ravenjax.store import manifest
from ravenjax.store.access import explained


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small campaign whose faults move the tip."""
    place = tmp_path_factory.mktemp("explain") / "tiny"
    rj.run(tiny_campaign.config(runs=40), out=place, engine="simd")
    return place


@pytest.fixture
def said(capsys):
    """Runs the command: (exit code, what was printed, what was complained of)."""

    def run(*words):
        capsys.readouterr()
        code = cli.main(["explain", *map(str, words)])
        printed = capsys.readouterr()
        return code, printed.out, " ".join(printed.err.split())

    return run


def test_one_run_in_a_terminal(said, folder, tmp_path):
    code, out, err = said(folder, "7", "--out", tmp_path)
    table: Any = explained.read_explained(tmp_path, manifest.read_manifest(folder))
    run = table["run_id"][0]
    assert code == 0 and out.startswith(f"run {run} · ") and not err
    text = " ".join(out.split())
    assert "dac: usb_out gold" in text and "gold/usb_out USB out" in text.replace("│ ", "")
    rows = list(csv.DictReader((tmp_path / f"{run}.csv").open()))
    assert rows[0]["signal"] == "gold/usb_out" and rows[0]["differs_in"] == "elbow"
    assert (tmp_path / f"{run}.svg").read_text().startswith("<?xml")


def test_json_is_the_chain_and_nothing_else(said, folder, tmp_path):
    code, out, _ = said(folder, "7", "8", "--json", "--out", tmp_path)
    first, second = json.loads(out)
    assert code == 0 and (first["index"], second["index"]) == (7, 8)
    assert first["links"][0]["signal"] == "gold/usb_out" and first["files"] == [
        str(tmp_path / f"{first['run_id']}.{kind}") for kind in ("csv", "svg")
    ]


def test_a_whole_campaign_and_the_python_api_say_the_same(said, folder):
    code, out, _ = said(folder, *range(3, 40), "--json")
    ticks: Any = explained.read_explained(folder / "explained", manifest.read_manifest(folder))
    assert code == 0 and len(json.loads(out)) == len(ticks) == 37
    table: Any = rj.explain(folder, engine="simd")
    assert table.attrs["campaign"] == "tiny" and set(table["run_id"]) <= set(ticks["run_id"])
    ours = table[(table["seam"] == "usb_out") & (table["index"] == 7)]["differs_ms"].item()
    theirs = ticks.set_index("index").loc[7]
    assert ours == min(t for t in theirs.filter(like="differs:gold/usb_out") if t >= 0)
    again = rj.explain(tiny_campaign.config(runs=40), [7], engine="simd")
    pd.testing.assert_frame_equal(again, table[table["index"] == 7].reset_index(drop=True))


def test_without_an_evading_fault_it_answers_at_once(said, folder, tmp_path):
    code, out, _ = said(folder, "--json", "--out", tmp_path / "none")
    assert code == 0 and "No fault evades" in json.loads(out)["sentences"][0]
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nowhere",), "nowhere: is not a result folder, because it has no manifest.json"),
        (
            ("FOLDER", "--group", "dak"),
            "--group 'dak': unknown, expected dac, free; did you mean dac?",
        ),
        (
            ("FOLDER", "7", "--engine", "mjx"),
            "engine 'mjx' cannot explain runs: expected auto or cuda, simd, xla",
        ),
    ],
)
def test_what_cannot_be_explained_is_one_error(said, folder, words, told):
    code, out, err = said(*(folder if word == "FOLDER" else word for word in words))
    assert code == cli.USER_ERROR and not out
    assert told.replace("FOLDER", str(folder)).split("; did")[0] in err

"""Two checkouts take turns, each measured as itself, and repeats say what tells them apart."""

from __future__ import annotations

import json
import shutil

import pytest

from ravenjax.bench import beside, start
from ravenjax.bench.beside import Beside, BesideRow
from ravenjax.bench.clock import Repeats
from ravenjax.cli import main
from ravenjax.errors import UserError


@pytest.fixture
def other(tmp_path):
    """Another checkout: commands end at once, and a campaign takes as long as it has runs of
    milliseconds.
    """
    package = tmp_path / "other/ravenjax"
    (package / "cli").mkdir(parents=True)
    (package / "__init__.py").write_text(
        "import time\ndef load_campaign(raw): return raw\n"
        "def run(campaign): time.sleep(1e-3 * campaign['group'][0]['runs'])\n"
    )
    (package / "cli/__init__.py").write_text("")
    (package / "cli/__main__.py").write_text("")
    return tmp_path / "other"


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(beside, "RUNS", 20)
    monkeypatch.setattr(beside, "ROUNDS", 3)


def test_both_are_measured_in_turn_as_themselves(other, few, tmp_path, monkeypatch):
    """The checkout that runs stands in for itself by another one that does nothing, too."""
    third = tmp_path / "copy"
    shutil.copytree(other, third)
    turns = []
    monkeypatch.chdir(start.ROOT)
    found = beside.measure(other, 60.0, turns.append, here=third)
    assert turns == [
        f"round {n}, {root}"
        for n, roots in enumerate(((third, other), (other, third), (third, other)), 1)
        for root in roots
    ]
    names = [row.what for row in found.rows]
    assert names[:2] == ["ravenjax run quick, nothing cached", "ravenjax run quick again"]
    assert names[-1].startswith("a campaign of 20 runs of 3.00 s on ")
    for row in found.rows:
        assert len(row.here.values) == len(row.there.values) == 3
    assert min(found.rows[-1].here.values) >= 0.02
    assert found.as_json()["rows"][0]["ratio"] == found.rows[0].ratio


def test_folders_that_are_no_other_checkout_are_refused(tmp_path):
    with pytest.raises(UserError, match="holds no ravenjax/__init__"):
        beside.measure(tmp_path, 1.0)
    with pytest.raises(UserError, match="is the checkout that runs"):
        beside.measure(start.ROOT, 1.0)


def test_a_checkout_that_fails_is_named(other, few):
    (other / "ravenjax/__init__.py").write_text("raise ValueError('torn')\n")
    third = other.parent / "third"
    shutil.copytree(other, third)
    with pytest.raises(RuntimeError, match=r"(?s)run quick .*: exit code 1: .*torn"):
        beside.measure(other, 1.0, here=third)
    (other / "ravenjax/__init__.py").write_text(
        "def load_campaign(raw): return raw\ndef run(campaign): 1 / 0\n"
    )
    with pytest.raises(
        RuntimeError, match=r"ravenjax\.run in .*other: exit code 1: .*ZeroDivisionError"
    ):
        beside._campaign_s(other, other, [0])


def test_a_package_that_is_measured_in_place_of_another_is_noticed(other, few):
    """Python takes what it finds first: here what is in the folder where it starts."""
    with pytest.raises(RuntimeError, match=r"was measured in place of .*nothing"):
        beside._campaign_s(other.parent / "nothing", other, [0])


@pytest.mark.parametrize(
    ("here", "there", "words"),
    [
        ((1.0, 1.1, 1.2, 1.0), (2.0, 2.2, 1.3, 1.3), "0.769 times as long here as there."),
        ((2.0, 2.1, 2.2, 2.0), (1.0, 1.1, 1.0, 1.0), "2 times as long here as there."),
        ((1.0, 1.1), (2.0, 2.2), "0.5 times as long here as there, in too few rounds to be sure."),
        ((1.0, 1.2), (1.1, 1.3), "repeats do not tell them apart (0.909 times at best)."),
        ((1.0,) * 4, (1.0,) * 4, "repeats do not tell them apart (1 times at best)."),
        ((1.0,), (1.0,), "1 times as long here as there, in too few rounds to be sure."),
    ],
)
def test_sentences_say_what_repeats_tell(here, there, words):
    found = Beside("/a", "/b", (BesideRow("x", Repeats(here), Repeats(there)),))
    assert found.sentences() == [
        f"Here is /a, there /b; {len(here)} round{'s' * (len(here) > 1)}.",
        f"x: {words}",
    ]
    _, columns, (row,) = found.table()
    assert len(row) == len(columns)


def test_the_command_shows_and_writes_it(tmp_path, monkeypatch, capsys):
    found = Beside("/a", "/b", (BesideRow("x", Repeats((1.0, 1.1)), Repeats((2.0, 2.2))),))
    monkeypatch.setattr(beside, "measure", lambda folder, total, tell: found)
    page = tmp_path / "page.md"
    assert main(["bench", "--beside", "b", "--markdown", str(page)]) == 0
    assert "x: 0.5 times as long here as there, in too few" in capsys.readouterr().out
    assert "| x | 1.00 s (2, +-5 %) | 2.00 s (2, +-5 %) | 0.5 |" in page.read_text()
    assert main(["bench", "--beside", "b", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"][0]["ratio"] == 0.5
    assert main(["bench", "--beside", "b", "--quick"]) == 2


def test_what_fails_is_a_message(other, few, monkeypatch, capsys):
    monkeypatch.setattr(beside.start, "commands", lambda place: [("torn", ("torn",))])
    (other / "ravenjax/cli/__main__.py").write_text("import sys\nsys.exit('no such\\ncommand')\n")
    real = beside.measure
    monkeypatch.setattr(
        beside,
        "measure",
        lambda folder, total, tell: real(folder, total, tell, other.parent / "third"),
    )
    shutil.copytree(other, other.parent / "third")
    assert main(["bench", "--beside", str(other)]) == 2
    assert f"--beside {other}: ravenjax torn: exit code 1: command" in "".join(
        capsys.readouterr()
    ).replace("\n", "")

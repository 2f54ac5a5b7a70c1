"""The report on the simulator's credibility: eight categories, each statement with files that
are what they were.
"""

import re
from pathlib import Path

import pytest
import synthetic_results as synthetic

from evidence import record, writing
from evidence.record import NOTICE
from evidence.writing import CredibilityStatement, ModelCredibility
from ravenjax import cli
from ravenjax.store.files import hash_file
from studies import claims

ROOT = Path(__file__).parents[2]
RUNS = 120


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "result"
    return synthetic.folder(place, synthetic.frame(RUNS), synthetic.manifest(RUNS))


def node_of(place, file):
    (node,) = [
        one
        for one in record.read_record(place).nodes
        if one.item is not None and one.item.file == file
    ]
    return node


def test_each_statement_of_the_model_stands_in_its_category_with_files_that_are_there(folder):
    assert (
        cli.main(["evidence", str(folder), "--credibility", str(ROOT / "results" / "reference")])
        == 0
    )
    place = folder / writing.FOLDER
    text = (place / writing.CREDIBILITY).read_text(encoding="utf-8")
    assert NOTICE in text and "not part of a submission" in text
    parts = re.split(r"^## (.*)$", text, flags=re.M)
    sections = dict(zip((title.lower() for title in parts[1::2]), parts[2::2], strict=True))
    assert [one for one in sections if one in claims.CATEGORIES] == list(claims.CATEGORIES)
    rows = claims.of_model().values()
    for category in claims.CATEGORIES:
        names = re.findall(r"^### (.*)$", sections[category], flags=re.M)
        assert [one.lower() for one in names] == [
            one.name.lower() for one in rows if one.category == category
        ]
        assert ("No evidence." in sections[category]) == (not names)
    linked = re.findall(r"^- \[(.*)\]\((.*)\), sha256 `(\w+)`$", text, flags=re.M)
    assert (
        len(linked) > 20
        and "not in this installation" not in text
        and "not in these findings" not in text
    )
    for name, target, digest in linked:
        assert (place / target).resolve() == ROOT / name and hash_file(ROOT / name) == digest
    assert {item.file for item in node_of(place, writing.CREDIBILITY).item.links} == {
        target for _, target, _ in linked
    }


def of_one(root):
    file = root / "tests" / "a.py"
    file.parent.mkdir()
    file.write_text("1")
    statements = (
        CredibilityStatement("code verification", "loop", "It is right.", (file, root / "gone.md")),
        CredibilityStatement("code verification", "again", "So is this.", (file,)),
    )
    return ModelCredibility(("code verification", "in vivo validation"), statements, root), file


def test_a_linked_file_that_changes_turns_its_goal_red_and_no_result(folder, tmp_path):
    root = tmp_path / "repository"
    root.mkdir()
    model, file = of_one(root)
    place = tmp_path / "evidence"
    writing.write([folder], place, model=model)
    text = (place / writing.CREDIBILITY).read_text(encoding="utf-8")
    assert "`gone.md`: not in this installation" in text and text.count("No evidence.") == 1
    assert not writing.check(place).of_status("broken")
    file.write_text("2")
    broken = {node.name: node for node in writing.check(place).of_status("broken")}
    assert str(file) in broken[node_of(place, writing.CREDIBILITY).name].reason
    goals = {node.text for node in broken.values() if node.kind == "goal"}
    assert writing.CREDIBILITY_GOAL in goals and len(goals) == 2, "its own and the top goal alone"


def test_without_findings_one_clear_error(folder, tmp_path, capsys):
    assert cli.main(["evidence", str(folder), "--credibility", str(tmp_path)]) == 2
    assert "no findings of a study there" in capsys.readouterr().err

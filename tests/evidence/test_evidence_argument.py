"""The argument: its nodes, YAML and drawing, and that what no longer holds turns red, with all
that rests on it.
"""

from __future__ import annotations

import itertools
import json
import shutil
import xml.etree.ElementTree as ET

import pytest
import synthetic_results as synthetic
import yaml

from ravenjax import cli
from ravenjax.errors import StoreError
from ravenjax.evidence import checking, drawing, record, writing
from ravenjax.evidence.notice import NOTICE
from ravenjax.evidence.record import EvidenceRecord, Item, Node
from ravenjax.store import manifest as manifests
from ravenjax.store.files import sha256
from ravenjax.store.folder import PARTS, ResultFolder

RUNS = 300
FRAME = synthetic.frame(RUNS)


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A folder that holds a result, and evidence of it."""
    place = tmp_path_factory.mktemp("argument") / "kept"
    results = ResultFolder.open(place / "result", synthetic.manifest(RUNS))
    for rows in results.missing(100):
        results.add(FRAME.iloc[rows.start : rows.stop])
    results.close(compile_s=1.0, run_s=1.0, rows=RUNS)
    writing.write([place / "result"], place / "evidence")
    return place


@pytest.fixture
def kept(original, tmp_path):
    """A copy elsewhere, that a test may damage: paths are from the evidence to the result."""
    return shutil.copytree(original, tmp_path / "moved")


@pytest.fixture
def said(capsys):
    """Runs the command: (exit code, what was printed, what was complained of)."""

    def run(*words):
        capsys.readouterr()
        code = cli.main(["evidence", *map(str, words)])
        printed = capsys.readouterr()
        return code, printed.out, " ".join(printed.err.split())

    return run


def argument(place):
    return yaml.safe_load((place / "evidence" / writing.YAML).read_text(encoding="utf-8"))


def statuses(place):
    """Node -> its status, as YAML and as SVG have it: they agree."""
    nodes = {name: node["status"] for name, node in argument(place)["nodes"].items()}
    tree = ET.parse(place / "evidence" / writing.SVG)
    drawn = {
        one.get("id"): one.get("class", "").split()[1] for one in tree.iter() if one.get("class")
    }
    assert drawn == nodes
    return nodes


def node_of(place, file):
    """The solution that is this file."""
    (name,) = (
        name
        for name, node in argument(place)["nodes"].items()
        if node.get("file", "").endswith(file)
    )
    return name


def test_every_solution_is_a_file_with_its_checksum(kept):
    nodes = argument(kept)["nodes"]
    solutions = [node for node in nodes.values() if node["kind"] == "solution"]
    files = [node["file"] for node in solutions if node["sha256_of"] == "file"]
    for node in solutions:
        path = kept / "evidence" / node["file"]
        assert path.is_file() and (
            node["sha256_of"] == "campaign" or sha256(path) == node["sha256"]
        )
    parts = [part.file for part in manifests.read(kept / "result").parts]
    assert sorted(files) == sorted(
        [*writing.GOALS, *(f"../result/{PARTS}/{name}" for name in parts)]
    )
    assert len(parts) == 3 and len(solutions) == len(files) + 1


def test_every_goal_comes_down_to_files(kept):
    nodes = argument(kept)["nodes"]
    assert next(iter(nodes)) == "G1" and {node["kind"] for node in nodes.values()} == {
        "goal",
        "strategy",
        "solution",
        "context",
    }
    for node in nodes.values():
        assert bool(node.get("supported_by")) == (node["kind"] in ("goal", "strategy"))
    reachable, todo = set(), ["G1"]
    while todo:
        name = todo.pop()
        reachable.add(name)
        todo += [*nodes[name].get("supported_by", []), *nodes[name].get("in_context_of", [])]
    assert reachable == set(nodes)


def test_what_it_is_not_is_said_in_every_file_that_can_say_it(kept):
    assert "no claim of conformity with any standard" in NOTICE
    for name in (writing.YAML, writing.SVG, writing.README, record.FILE):
        assert NOTICE in (kept / "evidence" / name).read_text(encoding="utf-8")


def test_all_holds_also_elsewhere(kept, said):
    before = (kept / "evidence" / record.FILE).read_bytes()
    code, out, err = said("--check", kept / "evidence")
    assert code == 0 and not err and "every checksum holds" in out
    assert set(statuses(kept).values()) == {"holds"} and argument(kept)["status"] == "holds"
    assert (kept / "evidence" / record.FILE).read_bytes() == before


def test_a_damaged_part_turns_red_with_what_rests_on_it(kept, said):
    part = manifests.read(kept / "result").parts[1].file
    with open(kept / "result" / PARTS / part, "r+b") as file:
        file.seek(300)
        byte = file.read(1)
        file.seek(300)
        file.write(bytes([byte[0] ^ 1]))
    code, out, err = said("--check", kept / "evidence")
    red, name = statuses(kept), node_of(kept, part)
    assert code == 1 and part in err and "1 broken" in out and red[name] == "broken"
    nodes = argument(kept)["nodes"]
    assert nodes[name]["reason"].endswith(f"expected {nodes[name]['sha256'][:16]}..")
    assert [
        one for one, node in nodes.items() if node["kind"] == "solution" and red[one] == "broken"
    ] == [name]
    goals = {one for one, node in nodes.items() if node["kind"] in ("goal", "strategy")}
    assert {one for one in goals if red[one] == "broken"} == goals  # tables rest on the parts, too
    assert {red[one] for one, node in nodes.items() if node["kind"] == "context"} == {"holds"}
    svg = (kept / "evidence" / writing.SVG).read_text(encoding="utf-8")
    assert f'<g class="solution broken" id="{name}">' in svg and drawing.RED in svg
    with open(kept / "result" / PARTS / part, "r+b") as file:
        file.seek(300)
        file.write(byte)
    assert said("--check", kept / "evidence")[0] == 0 and set(statuses(kept).values()) == {"holds"}


def test_a_changed_table_turns_red(kept, said):
    with open(kept / "evidence" / "failure_modes.csv", "a", encoding="utf-8") as file:
        file.write("more\n")
    assert said("--check", kept / "evidence")[0] == 1
    red = {name for name, status in statuses(kept).items() if status == "broken"}
    nodes = argument(kept)["nodes"]
    (goal,) = (
        n
        for n, one in nodes.items()
        if node_of(kept, "failure_modes.csv") in one.get("supported_by", [])
    )
    (strategy,) = (n for n, one in nodes.items() if goal in one.get("supported_by", []))
    assert red == {"G1", strategy, goal, node_of(kept, "failure_modes.csv")}


def test_a_part_that_is_gone(kept, said):
    part = manifests.read(kept / "result").parts[0].file
    (kept / "result" / PARTS / part).unlink()
    code, _, err = said("--check", kept / "evidence")
    assert (
        code == 1
        and f"{part}: is missing" in err
        and statuses(kept)[node_of(kept, part)] == "broken"
    )


def test_a_campaign_that_is_another_now(kept, said):
    folder = kept / "result"
    now = manifests.read(folder)
    manifests.write(folder, now.model_copy(update={"starts": now.starts + 1}))
    assert said("--check", kept / "evidence")[0] == 0
    manifests.write(folder, now.model_copy(update={"limit_mm": 2.0}))
    code, _, err = said("--check", kept / "evidence")
    assert code == 1 and "what decides outcomes in it changed" in err
    assert statuses(kept)[node_of(kept, manifests.FILE)] == "broken"


def test_runs_that_are_missing_leave_a_goal_open(tmp_path, said):
    results = ResultFolder.open(tmp_path / "half", synthetic.manifest(RUNS))
    results.add(FRAME.iloc[:100])
    code, out, err = said(tmp_path / "half")
    assert (
        code == 0
        and "100 of the 300 declared runs are there" in out
        and "200 runs are missing" in err
    )
    whole = yaml.safe_load(
        (tmp_path / "half" / writing.FOLDER / writing.YAML).read_text(encoding="utf-8")
    )
    assert (
        whole["status"] == "open"
        and [one["status"] for one in whole["nodes"].values()].count("open") == 1
    )


def test_several_results_stand_side_by_side(kept, said, tmp_path):
    shutil.copytree(kept / "result", tmp_path / "again")
    code, _, err = said(kept / "result", tmp_path / "again")
    assert code == 2 and "--out FOLDER" in err
    code, out, _ = said(kept / "result", tmp_path / "again", "--out", tmp_path / "both", "--json")
    plain = json.loads(out)
    assert code == 0 and plain["record_sha256"] == sha256(tmp_path / "both" / record.FILE)
    assert {line.split(",")[0] for line in plain["sentences"]} == {"R1", "R2"}
    lines = (tmp_path / "both" / "failure_modes.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert {line.split(",")[0] for line in lines} == {"R1", "R2"}
    single = (kept / "evidence" / "failure_modes.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert len(lines) == 2 * len(single)


def test_json_of_a_check(kept, said):
    code, out, _ = said("--check", kept / "evidence", "--json")
    plain = json.loads(out)
    assert (
        code == 0
        and plain["notice"] == NOTICE
        and {node["status"] for node in plain["nodes"]} == {"holds"}
    )


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "of which results?"),
        (["nowhere"], "is not a result folder"),
        (["--check", "nowhere"], "holds no evidence.json"),
        (["somewhere", "--check", "nowhere"], "--check FOLDER stands alone"),
        (["--xlsx", "--check", "nowhere"], "--check FOLDER stands alone"),
    ],
)
def test_bad_input_is_one_clear_error(said, tmp_path, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    code, out, err = said(*words)
    assert code == 2 and complaint in err and not out


def test_evidence_of_a_damaged_result_is_refused(kept, said):
    part = manifests.read(kept / "result").parts[0].file
    (kept / "result" / PARTS / part).write_bytes(b"nothing")
    code, _, err = said(kept / "result", "--out", kept / "new")
    assert code == 2 and part in err and not (kept / "new").exists()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda plain: plain | {"version": 9}, "is of version 9, expected 1"),
        (lambda plain: plain | {"nodes": []}, "nodes: Tuple should have at least 1 item"),
        (lambda plain: {"version": 1}, "Field required"),
        (lambda plain: plain | {"nodes": plain["nodes"][:1]}, "G1 rests on"),
    ],
)
def test_a_record_that_is_none(kept, change, complaint):
    path = kept / "evidence" / record.FILE
    path.write_text(
        json.dumps(change(json.loads(path.read_text(encoding="utf-8")))), encoding="utf-8"
    )
    with pytest.raises(StoreError, match=complaint):
        record.read(kept / "evidence")


def node(name, kind, *below, **fields):
    return Node(name=name, kind=kind, text=f"of {name}", supported_by=below, **fields)


def test_of_many_parts_the_broken_ones_are_drawn_first():
    parts = [
        node(f"Sn{k}", "solution", item=Item(file=f"p{k}", sha256="0" * 64)) for k in range(50)
    ]
    nodes = (node("G1", "goal", *(one.name for one in parts)), *parts)
    judged = checking.judged(nodes, {"Sn40": "is missing"})
    svg = drawing.svg(EvidenceRecord(written="now", sentences=(), nodes=judged))
    drawn = [
        one.get("id")
        for one in ET.fromstring(svg).iter()
        if one.get("class", "").startswith("solution")
    ]
    assert drawn[0] == "Sn40" and len(drawn) == drawing.MOST and "43 more files" in svg


def test_nodes_do_not_lie_on_each_other(kept):
    boxes, _ = drawing._placed(record.read(kept / "evidence"))
    columns = {}
    for box in boxes.values():
        columns.setdefault(box.x, []).append(box)
    assert len(columns) >= 5
    for column in columns.values():
        ordered = sorted(column, key=lambda box: box.y)
        for above, below in itertools.pairwise(ordered):
            assert above.y + above.height / 2 < below.y - below.height / 2


def test_words_are_escaped():
    whole = EvidenceRecord(
        written="now", sentences=(), nodes=(Node(name="G1", kind="goal", text="a < b & c"),)
    )
    assert "".join(ET.fromstring(drawing.svg(whole)).itertext()).count("a < b & c") == 1


def test_a_circle_ends():
    nodes = (node("G1", "goal", "G2"), node("G2", "goal", "G1"))
    assert [one.status for one in checking.judged(nodes, {})] == ["holds", "holds"]

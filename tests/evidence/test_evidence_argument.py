"""The argument: its nodes, JSON and drawing, and that what no longer holds turns red, with all
that rests on it.
"""

import json
import re
import shutil

import pytest
import synthetic_results as synthetic

from evidence import record, writing
from ravenjax import cli
from ravenjax.errors import StoreError
from ravenjax.store import manifest as manifests
from ravenjax.store.files import hash_file
from ravenjax.store.folder import PARTS, ResultFolder

RUNS = 300
FRAME = synthetic.frame(RUNS)


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A folder that holds a result, and evidence of it."""
    place = tmp_path_factory.mktemp("argument") / "kept"
    synthetic.folder(place / "result", FRAME, synthetic.manifest(RUNS), 100)
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


def argument(evidence):
    """The argument in a folder of evidence, with its nodes by name."""
    whole = json.loads((evidence / writing.JSON).read_text(encoding="utf-8"))
    return whole | {"nodes": {node["name"]: node for node in whole["nodes"]}}


def statuses(place):
    """Node -> its status, as JSON has it. The drawing marks the same nodes."""
    nodes = {name: node["status"] for name, node in argument(place / "evidence")["nodes"].items()}
    text = (place / "evidence" / writing.MERMAID).read_text(encoding="utf-8")
    marked = dict(re.findall(r"^class (\w+) (\w+)$", text, flags=re.M))
    assert marked == {name: status for name, status in nodes.items() if status != "holds"}
    return nodes


def node_of(place, file):
    """The solution that is this file."""
    (name,) = (
        name
        for name, node in argument(place / "evidence")["nodes"].items()
        if node["item"] and node["item"]["file"].endswith(file)
    )
    return name


def test_every_solution_is_a_file_with_its_checksum(kept):
    nodes = argument(kept / "evidence")["nodes"]
    solutions = [node for node in nodes.values() if node["kind"] == "solution"]
    items = [node["item"] for node in solutions]
    files = [item["file"] for item in items if item.get("of") != "campaign"]
    for item in items:
        path = kept / "evidence" / item["file"]
        assert path.is_file()
        assert item.get("of") == "campaign" or hash_file(path) == item["sha256"]
    parts = [part.file for part in manifests.read_manifest(kept / "result").parts]
    assert sorted(files) == sorted(
        [*writing.GOALS, *(f"../result/{PARTS}/{name}" for name in parts)]
    )
    assert len(parts) == 3 and len(solutions) == len(files) + 1


def test_every_goal_comes_down_to_files(kept):
    nodes = argument(kept / "evidence")["nodes"]
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


def test_all_holds_also_elsewhere(kept, said):
    before = (kept / "evidence" / record.FILE).read_bytes()
    code, out, err = said("--check", kept / "evidence")
    assert code == 0 and not err and "every checksum holds" in out
    assert (
        set(statuses(kept).values()) == {"holds"}
        and argument(kept / "evidence")["status"] == "holds"
    )
    assert (kept / "evidence" / record.FILE).read_bytes() == before


def test_a_damaged_part_turns_red_with_what_rests_on_it(kept, said):
    part = manifests.read_manifest(kept / "result").parts[1].file
    with open(kept / "result" / PARTS / part, "r+b") as file:
        file.seek(300)
        byte = file.read(1)
        file.seek(300)
        file.write(bytes([byte[0] ^ 1]))
    code, out, err = said("--check", kept / "evidence")
    red, name = statuses(kept), node_of(kept, part)
    assert code == 1 and part in err and "1 broken" in out and red[name] == "broken"
    nodes = argument(kept / "evidence")["nodes"]
    assert nodes[name]["reason"].endswith(f"expected {nodes[name]['item']['sha256'][:16]}..")
    assert [
        one for one, node in nodes.items() if node["kind"] == "solution" and red[one] == "broken"
    ] == [name]
    goals = {one for one, node in nodes.items() if node["kind"] in ("goal", "strategy")}
    assert {one for one in goals if red[one] == "broken"} == goals  # tables rest on the parts, too
    assert {red[one] for one, node in nodes.items() if node["kind"] == "context"} == {"holds"}
    with open(kept / "result" / PARTS / part, "r+b") as file:
        file.seek(300)
        file.write(byte)
    assert said("--check", kept / "evidence")[0] == 0 and set(statuses(kept).values()) == {"holds"}


def test_a_campaign_that_is_another_now(kept, said):
    folder = kept / "result"
    now = manifests.read_manifest(folder)
    manifests.write_manifest(folder, now.model_copy(update={"starts": now.starts + 1}))
    assert said("--check", kept / "evidence")[0] == 0
    manifests.write_manifest(folder, now.model_copy(update={"limit_mm": 2.0}))
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
    whole = argument(tmp_path / "half" / writing.FOLDER)
    assert (
        whole["status"] == "open"
        and [one["status"] for one in whole["nodes"].values()].count("open") == 1
    )


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "of which results?"),
        (["nowhere"], "is not a result folder"),
        (["--check", "nowhere"], "holds no evidence.json"),
        (["somewhere", "--check", "nowhere"], "--check FOLDER stands alone"),
    ],
)
def test_bad_input_is_one_clear_error(said, tmp_path, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    code, out, err = said(*words)
    assert code == 2 and complaint in err and not out


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda plain: plain | {"version": 9}, "version: Input should be 1"),
        (lambda plain: plain | {"nodes": plain["nodes"][:1]}, "nodes rest on"),
    ],
)
def test_a_record_that_is_none(kept, change, complaint):
    path = kept / "evidence" / record.FILE
    path.write_text(
        json.dumps(change(json.loads(path.read_text(encoding="utf-8")))), encoding="utf-8"
    )
    with pytest.raises(StoreError, match=complaint):
        record.read_record(kept / "evidence")

"""The exchange file is valid ReqIF, and what another reader finds in it is what the argument and
the table say.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import pytest
import synthetic_results as synthetic

from ravenjax import cli
from ravenjax.errors import UserError
from ravenjax.evidence import exchange, record, writing
from ravenjax.evidence.record import EvidenceRecord, Item, Node
from ravenjax.store.folder import PARTS, ResultFolder

reqif = pytest.importorskip("reqif")
xmlschema = pytest.importorskip("xmlschema")

RUNS = 120
SCHEMA = Path(reqif.__file__).parent / "reqif_schema" / "reqif.xsd"


@pytest.fixture
def place(tmp_path):
    folder = tmp_path / "result"
    results = ResultFolder.open(folder, synthetic.manifest(RUNS))
    results.add(synthetic.frame(RUNS))
    results.close(compile_s=1.0, run_s=1.0, rows=RUNS)
    assert cli.main(["evidence", str(folder), "--reqif"]) == 0
    return folder / writing.FOLDER


def content(path):
    """What the library reads, after the format's own schema."""
    from reqif.parser import ReqIFParser

    xmlschema.XMLSchema(str(SCHEMA), allow="local", defuse="never").validate(str(path))
    bundle = ReqIFParser.parse(str(path))
    assert not bundle.exceptions
    return bundle.core_content.req_if_content


def objects(parsed, kind):
    """Attributes of each object of a type, by their names."""
    (one,) = [t for t in parsed.spec_types if t.long_name == kind]
    names = {attribute.identifier: attribute.long_name for attribute in one.attribute_definitions}
    return [
        {names[value.definition_ref]: value.value for value in thing.attributes}
        for thing in parsed.spec_objects
        if thing.spec_object_type == one.identifier
    ]


def test_nodes_modes_and_relations_are_there(place):
    parsed, evidence = content(place / exchange.FILE), record.read(place)
    nodes = objects(parsed, "argument")
    assert [(one["name"], one["kind"], one["text"], one["status"]) for one in nodes] == [
        (node.name, node.kind, node.text, node.status) for node in evidence.nodes
    ]
    assert {one["file"]: one["sha256"] for one in nodes if one["file"]} == {
        node.item.file: node.item.sha256 for node in evidence.nodes if node.item
    }
    with open(place / exchange.MODES, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows and objects(parsed, "failure mode") == rows
    names = {thing.identifier: thing.long_name for thing in parsed.spec_objects}
    supports = [(names[one.source], names[one.target]) for one in parsed.spec_relations]
    expected = [
        (n.name, other) for n in evidence.nodes for other in (*n.supported_by, *n.in_context_of)
    ]
    assert [pair for pair in supports if not pair[0].isdigit()] == sorted(
        expected, key=supports.index
    )
    (table,) = [
        node.name for node in evidence.nodes if node.item and node.item.file == exchange.MODES
    ]
    assert sum(pair[1] == table and pair[0].isdigit() for pair in supports) == len(rows)
    assert [len(one.children) for one in parsed.specifications] == [len(nodes), len(rows)]


def test_any_text_comes_back(tmp_path):
    wild = "a < b & \"c\" > 'd' ]]> \u00fc \u4e2d\n<xhtml:div>\x00\x0b" + "x" * 9000
    nodes = (
        Node(name="G1", kind="goal", text=wild, supported_by=("Sn1",)),
        Node(name="Sn1", kind="solution", text="s", item=Item(file="a&b", sha256="0" * 64)),
    )
    evidence = EvidenceRecord(written="2026-01-01T00:00:00+00:00", sentences=(), nodes=nodes)
    path = tmp_path / "wild.reqif"
    path.write_text(exchange.text(evidence, None), encoding="utf-8")
    goal, solution = objects(content(path), "argument")
    expected = wild.replace("\x00", "").replace("\x0b", "")[: exchange.LONGEST]
    assert goal["text"].split() == expected.split() and solution["file"] == "a&b"


def test_the_same_evidence_is_the_same_file(place):
    evidence = record.read(place)
    assert exchange.text(evidence, place / exchange.MODES) == exchange.text(
        evidence, place / exchange.MODES
    )


def test_a_damaged_part_is_broken_there_too(place):
    part = next((place.parent / PARTS).glob("*.parquet"))
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(bytes(data))
    assert cli.main(["evidence", "--check", str(place)]) == 1
    states = {
        one["name"]: one["status"] for one in objects(content(place / exchange.FILE), "argument")
    }
    assert states["G1"] == "broken" and "holds" in states.values()


def test_of_a_damaged_table_no_failure_mode_is_told(place):
    (place / exchange.MODES).write_text('no,"table', encoding="utf-8")
    assert cli.main(["evidence", "--check", str(place)]) == 1
    parsed = content(place / exchange.FILE)
    assert {one.spec_object_type for one in parsed.spec_objects} == {"_type-argument"}


def test_without_the_package_one_clear_error(place, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "reqif.unparser", None)
    with pytest.raises(UserError, match=r"pip install 'ravenjax\[reqif\]'"):
        exchange.require()
    assert cli.main(["evidence", "--check", str(place)]) == 2
    assert "needs the package reqif" in capsys.readouterr().err


def test_evidence_without_it_leaves_none_of_before(place):
    assert cli.main(["evidence", str(place.parent)]) == 0
    assert not (place / exchange.FILE).exists()

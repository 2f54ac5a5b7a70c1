"""The argument and the failure modes for tools of requirements engineering, in the ReqIF format
(OMG, 1.2).

Its writer is an extra, imported only where somebody wants one. Nodes of the argument and failure
modes are objects, and what rests on what are relations; a failure mode rests on the solution that
is its table.
"""

from __future__ import annotations

import csv
import importlib
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ravenjax.errors import UserError
from ravenjax.evidence.record import EvidenceRecord, Node

FILE = "exchange.reqif"
MODES = "failure_modes.csv"
NAMESPACE = "http://www.omg.org/spec/ReqIF/20110401/reqif.xsd"
STRING = "string"
LONGEST = 8000
"""Letters of a text."""
NODE_KEYS = ("name", "kind", "text", "status", "reason", "file", "sha256")
"""Attributes of a node."""
RELATIONS = ("supported by", "in context of")
_NO_LETTER = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
"""What XML cannot hold."""


def require() -> None:
    """UserError where the package that writes is not installed."""
    try:
        importlib.import_module("reqif.unparser")
    except ImportError as error:
        raise UserError(
            "--reqif needs the package reqif, which is not installed: pip install"
            " 'ravenjax[reqif]'; the same tables and argument are written as CSV and YAML"
            " without it"
        ) from error


def text(evidence: EvidenceRecord, modes: Path | None) -> str:
    """The file's text. modes: table of failure modes (CSV), None to leave them out. Raises
    UserError as `require`.
    """
    require()
    from reqif.models.reqif_core_content import ReqIFCoreContent
    from reqif.models.reqif_data_type import ReqIFDataTypeDefinitionString
    from reqif.models.reqif_namespace_info import ReqIFNamespaceInfo
    from reqif.models.reqif_req_if_content import ReqIFReqIFContent
    from reqif.models.reqif_reqif_header import ReqIFReqIFHeader
    from reqif.object_lookup import ReqIFObjectLookup
    from reqif.reqif_bundle import ReqIFBundle
    from reqif.unparser import ReqIFUnparser

    time = evidence.checked or evidence.written
    header, rows = _table(modes)
    nodes = [_object("node", node.name, "argument", _node(node), time) for node in evidence.nodes]
    lines = [
        _object("mode", str(n), "failure mode", row, time) for n, row in enumerate(rows, start=1)
    ]
    content = ReqIFReqIFContent(
        data_types=[
            ReqIFDataTypeDefinitionString(
                _id(STRING), last_change=time, long_name=STRING, max_length=str(LONGEST)
            )
        ],
        spec_types=[*_types({"argument": NODE_KEYS, "failure mode": header}, time)],
        spec_objects=[*nodes, *lines],
        spec_relations=list(_relations(evidence, len(rows), time)),
        specifications=[
            _specification("argument", nodes, time),
            _specification("failure modes", lines, time),
        ],
    )
    bundle = ReqIFBundle(
        namespace_info=ReqIFNamespaceInfo.create_default(),
        req_if_header=ReqIFReqIFHeader(
            identifier=_id("header"),
            comment=evidence.notice,
            creation_time=time,
            req_if_tool_id="ravenjax",
            req_if_version="1.0",
            source_tool_id="ravenjax",
            title="Evidence",
        ),
        core_content=ReqIFCoreContent(content),
        tool_extensions_tag_exists=False,
        lookup=ReqIFObjectLookup.empty(),
        exceptions=[],
    )
    return ReqIFUnparser.unparse(bundle)


def _table(path: Path | None) -> tuple[list[str], list[dict[str, str]]]:
    """Columns and lines of a table."""
    if path is None:
        return [], []
    with open(path, encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        return list(reader.fieldnames or []), list(reader)


def _node(node: Node) -> dict[str, str]:
    """Attributes of a node, as NODE_KEYS."""
    item = node.item
    own = (node.name, node.kind, node.text, node.status, node.reason)
    return dict(
        zip(NODE_KEYS, (*own, item.file if item else "", item.sha256 if item else ""), strict=True)
    )


def _id(*words: str) -> str:
    """An identifier as XML has them: the same words, the same identifier."""
    return "_" + "-".join(re.sub(r"[^A-Za-z0-9.]+", "_", word) for word in words)


def _types(keys: Mapping[str, Iterable[str]], time: str) -> Iterator[Any]:
    """Of objects by their attributes, of relations, and of specifications."""
    from reqif.models.reqif_spec_object_type import ReqIFSpecObjectType, SpecAttributeDefinition
    from reqif.models.reqif_spec_relation_type import ReqIFSpecRelationType
    from reqif.models.reqif_specification_type import ReqIFSpecificationType
    from reqif.models.reqif_types import SpecObjectAttributeType

    for name, columns in keys.items():
        attributes = [
            SpecAttributeDefinition(
                SpecObjectAttributeType.STRING,
                _id("key", name, key),
                _id(STRING),
                last_change=time,
                long_name=key,
            )
            for key in columns
        ]
        yield ReqIFSpecObjectType(_id("type", name), None, time, name, attributes or None)
    for name in RELATIONS:
        yield ReqIFSpecRelationType(_id("type", name), last_change=time, long_name=name)
    yield ReqIFSpecificationType(
        _id("type", "specification"),
        last_change=time,
        long_name="specification",
        is_self_closed=True,
    )


def _object(kind: str, name: str, type_name: str, values: Mapping[str, str], time: str) -> Any:
    from reqif.models.reqif_spec_object import ReqIFSpecObject, SpecObjectAttribute
    from reqif.models.reqif_types import SpecObjectAttributeType

    attributes = [
        SpecObjectAttribute(
            SpecObjectAttributeType.STRING,
            _id("key", type_name, key),
            _NO_LETTER.sub("", value)[:LONGEST],
        )
        for key, value in values.items()
    ]
    return ReqIFSpecObject(
        _id(kind, name), attributes, _id("type", type_name), last_change=time, long_name=name
    )


def _relations(evidence: EvidenceRecord, modes: int, time: str) -> Iterator[Any]:
    """What rests on what."""
    from reqif.models.reqif_spec_relation import ReqIFSpecRelation

    pairs = [
        (relation, _id("node", node.name), _id("node", other))
        for node in evidence.nodes
        for relation, others in zip(RELATIONS, (node.supported_by, node.in_context_of), strict=True)
        for other in others
    ]
    table = [
        _id("node", node.name)
        for node in evidence.nodes
        if node.item is not None and node.item.file == MODES
    ]
    pairs += [
        (RELATIONS[0], _id("mode", str(n)), one)
        for n, one in itertools.product(range(1, modes + 1), table)
    ]
    for number, (relation, source, target) in enumerate(pairs, start=1):
        yield ReqIFSpecRelation(
            _id("relation", str(number)), _id("type", relation), source, target, last_change=time
        )


def _specification(name: str, objects: Sequence[Any], time: str) -> Any:
    """A flat list of objects, in their order."""
    from reqif.models.reqif_spec_hierarchy import ReqIFSpecHierarchy
    from reqif.models.reqif_specification import ReqIFSpecification

    rows = [
        ReqIFSpecHierarchy(
            identifier=f"_row{one.identifier}",
            spec_object=one.identifier,
            level=1,
            last_change=time,
            editable=None,
            is_table_internal=None,
        )
        for one in objects
    ]
    return ReqIFSpecification(
        _id("specification", name),
        last_change=time,
        long_name=name,
        specification_type=_id("type", "specification"),
        children=rows,
    )

"""The argument as YAML. Every word is written as JSON writes it, which YAML reads alike."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from ravenjax.evidence.record import EvidenceRecord, Node


def text(evidence: EvidenceRecord) -> str:
    """All of it: the notice, what the results say, and each node."""
    whole = {
        "notice": evidence.notice,
        "notation": "GSN: goals, strategies, solutions, contexts",
        "written": evidence.written,
        "checked": evidence.checked,
        "status": (
            "broken"
            if evidence.of_status("broken")
            else "open"
            if evidence.of_status("open")
            else "holds"
        ),
        "results": list(evidence.sentences),
        "nodes": {node.name: _fields(node) for node in evidence.nodes},
    }
    return f"# {evidence.notice}\n" + "\n".join(_lines(whole, 0)) + "\n"


def _fields(node: Node) -> dict[str, Any]:
    plain: dict[str, Any] = {"kind": node.kind, "text": node.text, "status": node.status}
    if node.reason:
        plain["reason"] = node.reason
    if node.item is not None:
        plain |= {"file": node.item.file, "sha256": node.item.sha256, "sha256_of": node.item.of}
    for name, links in (("supported_by", node.supported_by), ("in_context_of", node.in_context_of)):
        if links:
            plain[name] = list(links)
    return plain


def _lines(tree: dict[str, Any], depth: int) -> Iterator[str]:
    space = "  " * depth
    for key, value in tree.items():
        if isinstance(value, dict):
            yield f"{space}{key}:"
            yield from _lines(value, depth + 1)
        elif isinstance(value, list):
            yield f"{space}{key}:" + ("" if value else " []")
            yield from (f"{space}  - {_word(item)}" for item in value)
        else:
            yield f"{space}{key}: {_word(value)}"


def _word(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)

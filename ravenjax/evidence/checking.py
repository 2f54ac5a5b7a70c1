"""Whether what an argument rests on is still what it was: checksums computed again, and what
follows for each node.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from ravenjax import threads
from ravenjax.errors import StoreError
from ravenjax.evidence.record import BROKEN, HOLDS, EvidenceRecord, Item, Node
from ravenjax.evidence.sources import identity
from ravenjax.store import manifest as manifests
from ravenjax.store.files import sha256
from ravenjax.store.folder import READERS


def check(folder: Path, evidence: EvidenceRecord) -> EvidenceRecord:
    """The same evidence, each node as it is now. folder: where it lies."""
    items = {node.name: node.item for node in evidence.nodes if node.item is not None}
    problems = threads.mapped(lambda item: problem(folder, item), items.values(), READERS)
    reasons = dict(zip(items, problems, strict=True))
    return evidence.model_copy(
        update={"checked": manifests.now(), "nodes": judged(evidence.nodes, reasons)}
    )


def problem(folder: Path, item: Item) -> str:
    """What is wrong with a file that evidence in `folder` rests on, or with one that it links,
    "" where nothing is.
    """
    own = _of_one(folder, item)
    return own or next(filter(None, (_of_one(folder, link) for link in item.links)), "")


def _of_one(folder: Path, item: Item) -> str:
    path = Path(os.path.normpath(folder / item.file))
    try:
        digest = sha256(path) if item.of == "file" else identity(manifests.read(path.parent))
    except FileNotFoundError:
        return f"{path}: is missing"
    except OSError as error:
        return f"{path}: cannot be read ({error.strerror or error})"
    except StoreError as error:
        return str(error)
    if digest == item.sha256:
        return ""
    what = "its content" if item.of == "file" else "what decides outcomes in it"
    return f"{path}: {what} changed: sha256 {digest[:16]}.., expected {item.sha256[:16]}.."


def judged(nodes: Sequence[Node], problems: Mapping[str, str]) -> tuple[Node, ...]:
    """Each node with its status: broken where its file is, or where anything that it rests on is
    broken.

    problems: of each solution, "" where nothing is wrong. A status `open` stays, where nothing is
    broken.
    """
    by_name = {node.name: node for node in nodes}
    states: dict[str, str] = {}

    def reason(name: str) -> str:
        if name not in states:
            states[name] = problems.get(
                name, ""
            )  # before its supports: a record with a circle ends, too
            below = [one for one in by_name[name].supported_by if reason(one)]
            states[name] = states[name] or (f"rests on {', '.join(below)}" if below else "")
        return states[name]

    return tuple(_with_status(node, reason(node.name)) for node in nodes)


def _with_status(node: Node, reason: str) -> Node:
    if reason:
        return node.model_copy(update={"status": BROKEN, "reason": reason})
    return (
        node if node.status != BROKEN else node.model_copy(update={"status": HOLDS, "reason": ""})
    )

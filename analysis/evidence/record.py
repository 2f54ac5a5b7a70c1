"""The record of written evidence: nodes of the argument with checksums of their files, and the
check of these.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import jinja2
import pydantic
from pydantic import BaseModel, ConfigDict, Field

from evidence.sources import identify
from ravenjax import threads
from ravenjax.errors import StoreError
from ravenjax.store import manifest as manifests
from ravenjax.store.files import parsed, sha256, write_aside
from ravenjax.store.folder import READERS

NOTICE = (
    "This is output of a simulation. It makes no claim of conformity with any standard, regulation"
    " or guidance, it is no risk assessment, and it says nothing of how often a fault occurs."
)
"""What evidence is not; every file carries it that can."""
FILE = "evidence.json"
VERSION = 1
Status = Literal["holds", "open", "broken"]
"""As it was written; not finished, as where runs are missing; it rests on something that is no
longer what it was.
"""


class Item(BaseModel):
    """What a solution is: a file to the byte, or what of a manifest decides outcomes."""

    model_config = ConfigDict(frozen=True)

    file: str  # from the folder of the evidence
    sha256: str
    of: Literal["file", "campaign"] = "file"
    links: tuple[Item, ...] = ()  # files that it names, which must be what they were, too


class Node(BaseModel):
    """One node of the argument, in the goal structuring notation."""

    model_config = ConfigDict(frozen=True)

    name: str  # G1, S1, Sn1, C1
    kind: Literal["goal", "strategy", "solution", "context"]
    text: str
    supported_by: tuple[str, ...] = ()
    in_context_of: tuple[str, ...] = ()
    status: Status = "holds"
    reason: str = ""  # of another status than `holds`
    item: Item | None = None  # of a solution


class EvidenceRecord(BaseModel):
    """What `ravenjax evidence` wrote. Times are UTC, ISO 8601."""

    model_config = ConfigDict(frozen=True)

    version: int = VERSION
    notice: str = NOTICE
    written: str
    checked: str | None = None  # when checksums were last computed again
    sentences: tuple[str, ...]  # the results, a sentence each
    nodes: tuple[Node, ...] = Field(min_length=1)  # the top goal first

    def of_status(self, status: Status) -> list[Node]:
        """Nodes of a status, in order."""
        return [node for node in self.nodes if node.status == status]


def fill_template(name: str, **values: object) -> str:
    """A page in Markdown from the template of that name in this folder."""
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    return templates.get_template(name).render(notice=NOTICE, **values)


def read_record(folder: Path) -> EvidenceRecord:
    """The record in a folder. Raises StoreError where there is none, it is damaged, or newer
    than this reader.
    """
    path = folder / FILE
    again = "Write it again with `ravenjax evidence DIR... --out FOLDER`."
    try:
        data = parsed(path.read_text(encoding="utf-8"))
        if isinstance(data, dict) and data.get("version", VERSION) != VERSION:
            raise StoreError(
                f"{path}: is of version {data['version']}, expected {VERSION}. {again}"
            )
        evidence = EvidenceRecord.model_validate(data)
    except FileNotFoundError as error:
        raise StoreError(
            f"{folder}: holds no {FILE}; give a folder that `ravenjax evidence` wrote"
        ) from error
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror or error})") from error
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(item) for item in first["loc"]) or "top level"
        raise StoreError(f"{path}: {where}: {first['msg']}. {again}") from error
    except ValueError as error:
        raise StoreError(f"{path}: is not valid JSON ({error}). {again}") from error
    names = {node.name for node in evidence.nodes}
    for node in evidence.nodes:
        if unknown := {*node.supported_by, *node.in_context_of} - names:
            raise StoreError(
                f"{path}: {node.name} rests on {', '.join(sorted(unknown))}, which it lacks."
                f" {again}"
            )
    return evidence


def write_record(folder: Path, evidence: EvidenceRecord) -> None:
    """Replace the record in one step."""
    text = evidence.model_dump_json(indent=1) + "\n"
    write_aside(folder / FILE, lambda target: target.write_text(text, encoding="utf-8"))


def check_record(folder: Path, evidence: EvidenceRecord) -> EvidenceRecord:
    """The evidence with the present status of each node. folder: where it lies."""
    items = {node.name: node.item for node in evidence.nodes if node.item is not None}
    problems = threads.mapped(lambda item: _find_problem(folder, item), items.values(), READERS)
    nodes = judge(evidence.nodes, dict(zip(items, problems, strict=True)))
    return evidence.model_copy(update={"checked": manifests.now(), "nodes": nodes})


def _find_problem(folder: Path, item: Item) -> str:
    """What is wrong with a file that evidence in `folder` rests on, or with one that it links,
    "" where nothing is.
    """
    path = Path(os.path.normpath(folder / item.file))
    try:
        digest = sha256(path) if item.of == "file" else identify(manifests.read(path.parent))
    except FileNotFoundError:
        return f"{path}: is missing"
    except OSError as error:
        return f"{path}: cannot be read ({error.strerror or error})"
    except StoreError as error:
        return str(error)
    if digest != item.sha256:
        what = "its content" if item.of == "file" else "what decides outcomes in it"
        return f"{path}: {what} changed: sha256 {digest[:16]}.., expected {item.sha256[:16]}.."
    return next(filter(None, (_find_problem(folder, link) for link in item.links)), "")


def judge(nodes: Sequence[Node], problems: Mapping[str, str]) -> tuple[Node, ...]:
    """Each node with its status: broken where its file is, or where anything that it rests on is
    broken. A status `open` stays, where nothing is broken.

    problems: of each solution, "" where nothing is wrong.
    """
    by_name = {node.name: node for node in nodes}
    reasons: dict[str, str] = {}

    def find_reason(name: str) -> str:
        if name not in reasons:
            # before its supports, so that a record with a circle ends
            reasons[name] = problems.get(name, "")
            below = [other for other in by_name[name].supported_by if find_reason(other)]
            if below and not reasons[name]:
                reasons[name] = f"rests on {', '.join(below)}"
        return reasons[name]

    judged = []
    for node in nodes:
        if reason := find_reason(node.name):
            node = node.model_copy(update={"status": "broken", "reason": reason})
        elif node.status == "broken":
            node = node.model_copy(update={"status": "holds", "reason": ""})
        judged.append(node)
    return tuple(judged)

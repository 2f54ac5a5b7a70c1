"""Opens the result folders from which evidence for a risk file is written. Reads, writes and checks
`evidence.json`: nodes of the argument with checksums of their files.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Literal, NamedTuple

import jinja2
import pydantic
from pydantic import BaseModel, Field

from ravenjax import threads
from ravenjax.errors import StoreError, UserError
from ravenjax.report.data.runs import Runs
from ravenjax.stats.intervals import Rate
from ravenjax.store import manifest as manifests
from ravenjax.store.files import hash_file, write_aside
from ravenjax.store.folder import READERS
from ravenjax.store.manifest import Manifest

NOTICE = (
    "This is output of a simulation. It makes no claim of conformity with any standard, regulation"
    " or guidance, it is no risk assessment, and it says nothing of how often a fault occurs."
)
FILE = "evidence.json"
_DECIDES = {
    *("schema_version", "config", "config_hash", "seed", "runs", "duration_ms", "shape", "cues"),
    *("detectors", "verdict_cue", "verdict_jump", "limit_mm", "engine", "device", "versions"),
    *("code_hash", "shard"),
}
"""Fields of a manifest that decide outcomes."""


class Source(NamedTuple):
    name: str  # R1, R2 ...: two campaigns may have the same name
    folder: Path
    record: Manifest
    runs: Runs


@contextlib.contextmanager
def opened(folders: Sequence[Path]) -> Iterator[list[Source]]:
    """Open result folders, in order. Raises UserError if one is named twice, and StoreError."""
    for folder, count in Counter(map(Path.resolve, folders)).items():
        if count > 1:
            twice = f"{folder}: is named {count} times"
            raise UserError(f"{twice}; name each result folder once, or its faults count double")
    with contextlib.ExitStack() as stack:
        sources = []
        for number, folder in enumerate(folders, start=1):
            record = manifests.read_manifest(folder)
            runs = stack.enter_context(contextlib.closing(Runs.open(folder, record)))
            sources.append(Source(f"R{number}", folder, record, runs))
        yield sources


def identify(record: Manifest) -> str:
    """Return the sha256 of the part of a manifest that decides outcomes."""
    plain = json.loads(record.model_dump_json(include=_DECIDES))
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


EXAMPLE_RUNS = "array_to_string(arg_min(r.run_id, f.row, 3), ' ')"


def interval_in_words(rate: Rate) -> str:
    return "none: not all of the faults were drawn" if math.isnan(rate.low) else "Wilson, 95 %"


Status = Literal["holds", "open", "broken"]
"""Status of a node. open: not finished. broken: a file that it rests on has changed."""


class _Frozen(BaseModel, frozen=True):
    pass


class Item(_Frozen):
    """The content of a solution: a whole file, or the part of a manifest that decides outcomes."""

    file: str  # relative to the folder of the evidence
    sha256: str
    of: Literal["file", "campaign"] = "file"
    links: tuple[Item, ...] = ()  # files that it names, which must be unchanged too


class Node(_Frozen):
    """One node of the argument, in the goal structuring notation."""

    name: str  # such as G1, S1, Sn1, C1
    kind: Literal["goal", "strategy", "solution", "context"]
    text: str
    supported_by: tuple[str, ...] = ()
    in_context_of: tuple[str, ...] = ()
    status: Status = "holds"
    reason: str = ""  # reason for a status other than `holds`
    item: Item | None = None  # the content of a solution


class EvidenceRecord(_Frozen):
    """The output of `ravenjax evidence`. Times are UTC, ISO 8601."""

    version: Literal[1] = 1
    notice: str = NOTICE
    written: str
    checked: str | None = None  # time at which checksums were last computed again
    sentences: tuple[str, ...]  # the results, one sentence each
    nodes: tuple[Node, ...] = Field(min_length=1)  # the top goal comes first

    @pydantic.computed_field
    @property
    def status(self) -> Status:
        """The worst status of a node."""
        if self.of_status("broken"):
            return "broken"
        return "open" if self.of_status("open") else "holds"

    @pydantic.model_validator(mode="after")
    def _order(self) -> EvidenceRecord:
        supports = {node.name: node.supported_by for node in self.nodes}
        # Raises ValueError for a cycle.
        ordered = list(TopologicalSorter(supports).static_order())
        context = [name for node in self.nodes for name in node.in_context_of]
        if missing := sorted({*ordered, *context} - supports.keys()):
            raise ValueError(f"nodes rest on {', '.join(missing)}, which is missing")
        return self

    def of_status(self, status: Status) -> list[Node]:
        """Return the nodes of a status, in order."""
        return [node for node in self.nodes if node.status == status]


def fill_template(name: str, **values: object) -> str:
    """Fill a Markdown template of this folder. No value becomes HTML, a link or several lines."""
    marks = re.compile(r"<(?=[\w/!?])|\](?=[(\[:])|[\x00-\x1f]+")
    plain = {"<": "&lt;", "]": "\\]"}
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        finalize=lambda value: marks.sub(lambda mark: plain.get(mark[0], " "), str(value)),
    )
    return templates.get_template(name).render(notice=NOTICE, **values)


def read_record(folder: Path) -> EvidenceRecord:
    """Return the record in a folder. Raises StoreError if it is missing, damaged, or newer."""
    path = folder / FILE
    again = "Write it again with `ravenjax evidence DIR... --out FOLDER`."
    try:
        return EvidenceRecord.model_validate_json(path.read_bytes())
    except FileNotFoundError as error:
        raise StoreError(
            f"{folder}: holds no {FILE}; give a folder that `ravenjax evidence` wrote"
        ) from error
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror or error})") from error
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "top level"
        raise StoreError(f"{path}: {where}: {first['msg']}. {again}") from error


def write_record(folder: Path, evidence: EvidenceRecord) -> None:
    """Replace the record atomically."""
    text = evidence.model_dump_json(indent=1) + "\n"
    write_aside(folder / FILE, lambda target: target.write_text(text, encoding="utf-8"))


def check_record(folder: Path, evidence: EvidenceRecord) -> EvidenceRecord:
    """Return the evidence with the present status of each node. `folder`: of the evidence."""
    items = {node.name: node.item for node in evidence.nodes if node.item is not None}
    find = partial(_find_problem, folder)
    problems = threads.map_in_threads(find, items.values(), READERS)
    nodes = judge(evidence.nodes, dict(zip(items, problems, strict=True)))
    return evidence.model_copy(update={"checked": manifests.utc_now(), "nodes": nodes})


def _find_problem(folder: Path, item: Item) -> str:
    """Return what is wrong with a file of evidence, or with one that it links; "" if nothing is."""
    path = Path(os.path.normpath(folder / item.file))
    try:
        whole = item.of == "file"
        digest = hash_file(path) if whole else identify(manifests.read_manifest(path.parent))
    except FileNotFoundError:
        return f"{path}: is missing"
    except OSError as error:
        return f"{path}: cannot be read ({error.strerror or error})"
    except StoreError as error:
        return str(error)
    if digest != item.sha256:
        what = "its content" if whole else "what decides outcomes in it"
        return f"{path}: {what} changed: sha256 {digest[:16]}.., expected {item.sha256[:16]}.."
    return next(filter(None, (_find_problem(folder, link) for link in item.links)), "")


def judge(nodes: Sequence[Node], problems: Mapping[str, str]) -> tuple[Node, ...]:
    """Return each node with its status: broken if its file is (`problems`: of each solution, or
    ""), or if it rests on a broken node. Otherwise a status `open` stays.
    """
    supports, reasons = {node.name: node.supported_by for node in nodes}, dict(problems)
    for name in TopologicalSorter(supports).static_order():
        if below := [other for other in supports[name] if reasons.get(other)]:
            reasons[name] = f"rests on {', '.join(below)}"

    def update(node: Node) -> Node:
        if reason := reasons.get(node.name):
            return node.model_copy(update={"status": "broken", "reason": reason})
        if node.status == "broken":
            return node.model_copy(update={"status": "holds", "reason": ""})
        return node

    return tuple(map(update, nodes))

"""The record of evidence that was written: nodes of the argument, and a checksum for each file
it rests on.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pydantic
from pydantic import BaseModel, ConfigDict, Field

from ravenjax.errors import StoreError
from ravenjax.evidence.notice import NOTICE
from ravenjax.store.files import parsed, write_aside

FILE = "evidence.json"
VERSION = 1

HOLDS, OPEN, BROKEN = "holds", "open", "broken"
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


def read(folder: Path) -> EvidenceRecord:
    """The record in a folder. Raises StoreError where there is none, it is damaged, or newer
    than this reader.
    """
    path = folder / FILE
    again = "Write it again with `ravenjax evidence DIR... --out FOLDER`."
    try:
        data = parsed(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise StoreError(
            f"{folder}: holds no {FILE}; give a folder that `ravenjax evidence` wrote"
        ) from error
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise StoreError(f"{path}: is not valid JSON ({error}). {again}") from error
    version = data.get("version") if isinstance(data, dict) else None
    if isinstance(version, int) and version != VERSION:
        raise StoreError(f"{path}: is of version {version}, expected {VERSION}. {again}")
    try:
        evidence = EvidenceRecord.model_validate(data)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(item) for item in first["loc"]) or "top level"
        raise StoreError(f"{path}: {where}: {first['msg']}. {again}") from error
    names = {node.name for node in evidence.nodes}
    for node in evidence.nodes:
        if unknown := {*node.supported_by, *node.in_context_of} - names:
            raise StoreError(
                f"{path}: {node.name} rests on {', '.join(sorted(unknown))}, which it lacks."
                f" {again}"
            )
    return evidence


def write(folder: Path, evidence: EvidenceRecord) -> None:
    """Replace the record in one step."""
    text = evidence.model_dump_json(indent=1) + "\n"
    write_aside(folder / FILE, lambda target: target.write_text(text, encoding="utf-8"))

"""The result folders that evidence rests on, open to be asked."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ravenjax.errors import UserError
from ravenjax.report.data.runs import Runs
from ravenjax.store import manifest as manifests
from ravenjax.store.manifest import Manifest

_DECIDES = {
    "schema_version",
    "config",
    "config_hash",
    "seed",
    "runs",
    "duration_ms",
    "shape",
    "cues",
    "detectors",
    "verdict_cue",
    "verdict_jump",
    "limit_mm",
    "engine",
    "device",
    "versions",
    "code_hash",
    "lock_hash",
    "shard",
}
"""Fields of a manifest that decide outcomes, or what they are called; the others tell of starts
and times.
"""


class Source(NamedTuple):
    """One result."""

    name: str  # R1, R2 ...: two campaigns may be called alike
    folder: Path
    record: Manifest
    runs: Runs


@contextlib.contextmanager
def opened(folders: Sequence[Path]) -> Iterator[list[Source]]:
    """Those of result folders, in order. Raises UserError where one is named twice, StoreError
    as `Runs.open`.
    """
    places = [folder.resolve() for folder in folders]
    for place, folder in enumerate(folders):
        if places[place] in places[:place]:
            raise UserError(
                f"{folder}: is named twice; each result folder once, or its faults would count"
                " double"
            )
    with contextlib.ExitStack() as stack:
        sources = []
        for number, folder in enumerate(folders, start=1):
            record = manifests.read(folder)
            runs = stack.enter_context(contextlib.closing(Runs.open(folder, record)))
            sources.append(Source(f"R{number}", folder, record, runs))
        yield sources


def identity(record: Manifest) -> str:
    """sha256 of what of a manifest decides outcomes: starting a finished campaign again does not
    change it.
    """
    plain = json.loads(record.model_dump_json(include=_DECIDES))
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()

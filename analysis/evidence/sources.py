"""Opens the result folders from which evidence for a risk file is written."""

import contextlib
import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ravenjax.errors import UserError
from ravenjax.report.data.runs import Runs
from ravenjax.stats.intervals import Rate
from ravenjax.store import manifest as manifests
from ravenjax.store.manifest import Manifest

_DECIDES = {
    *("schema_version", "config", "config_hash", "seed", "runs", "duration_ms", "shape", "cues"),
    *("detectors", "verdict_cue", "verdict_jump", "limit_mm", "engine", "device", "versions"),
    *("code_hash", "shard"),
}
"""Fields of a manifest that decide outcomes. The others describe starts and times."""


class Source(NamedTuple):
    """One result."""

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
"""SQL: ids of the first rows of a group."""


def interval_in_words(rate: Rate) -> str:
    """Return how the interval of a rate was computed."""
    return "none: not all of the faults were drawn" if math.isnan(rate.low) else "Wilson, 95 %"

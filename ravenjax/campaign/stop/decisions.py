"""Reads and writes decisions.jsonl of a result folder: one line per look of a stop rule."""

from collections.abc import Sequence
from pathlib import Path

from ravenjax.errors import StoreError
from ravenjax.stats import sequential
from ravenjax.stats.sequential import Look
from ravenjax.store.files import write_text

FILE = "decisions.jsonl"


def write_looks(folder: Path, looks: Sequence[Look]) -> None:
    """Write all looks so far, atomically. Raise StoreError if the file cannot be written."""
    text = "".join(f"{look.model_dump_json()}\n" for look in looks)
    write_text(folder / FILE, text)


def read_looks(folder: Path) -> list[Look]:
    """Return the looks of a folder; [] without a stop rule. Raises StoreError for a broken file."""
    path = folder / FILE
    try:
        return [Look.model_validate_json(line) for line in path.read_text("utf-8").splitlines()]
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise StoreError(
            f"{path}: cannot be read ({reason}). Delete it and start the same `ravenjax run`"
            " again, which computes this file from the results."
        ) from error


def describe_stop(folder: Path) -> str:
    """Return why a campaign stopped, or "" without a stop rule. Raises StoreError."""
    looks = read_looks(folder)
    return sequential.describe_stop(looks) if looks else ""

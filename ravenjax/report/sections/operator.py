"""Section "Operator": the contents of a recorded operator's file, and the part that is replayed."""

from pathlib import Path
from typing import Any

from ravenjax.store.motion.summary import MotionSummary, describe_changes, table_rows


def operator_content(summary: MotionSummary | None) -> dict[str, Any] | None:
    """Return the template's variables for a recorded motion; None for a generated motion."""
    if summary is None:
        return None
    rows = table_rows(summary)
    return {
        "summary": summary,
        "file": Path(summary.file).name,
        "rows": rows,
        "cells": [{"what": what, "how it is": how} for what, how in rows],
        "changes": describe_changes(summary),
    }


SECTIONS = {"operator": lambda runs, _: operator_content(runs.manifest.operator)}

"""Section "Operator": what a recorded operator's file holds, and what is replayed of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ravenjax.report.sections import Section
from ravenjax.store.motion.summary import MotionSummary, changes, table_rows


def content(summary: MotionSummary | None) -> dict[str, Any] | None:
    """What the page shows of a recorded operator; None of a generated one."""
    if summary is None:
        return None
    rows = table_rows(summary)
    return {
        "summary": summary,
        "file": Path(summary.file).name,
        "rows": rows,
        "cells": [{"what": what, "how it is": how} for what, how in rows],
        "changes": changes(summary),
    }


SECTIONS = (Section("operator", "Operator", 170, lambda runs, _: content(runs.manifest.operator)),)

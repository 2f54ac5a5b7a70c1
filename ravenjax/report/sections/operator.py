"""The recorded operator: what became of the recording, and its tip before and after."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import Any

from ravenjax.report.sections import Section
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.store.motion.resampling import TICK_S
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
        "redraw": _command(summary),  # draws it in full
    }


SECTIONS = (Section("operator", "Operator", 170, lambda runs, _: content(runs.manifest.operator)),)


def _command(summary: MotionSummary) -> str:
    begin, end = summary.window_s
    keys = {
        name: f"{value}"
        for name, value in dataclasses.asdict(summary.options).items()
        if value != getattr(ReplayOptions(), name)
    }
    keys["window_s"] = f"[{begin:.3f},{end + TICK_S:.3f}]"
    arms = " ".join(one.arm for one in summary.arms)
    return f"ravenjax motion {shlex.quote(summary.file)} --arms {arms} --set " + " ".join(
        shlex.quote(f"operator.{name}={value}") for name, value in keys.items()
    )

"""progress.json in a result folder: how far the campaign is, for whatever watches it from outside.

It is replaced in one step, at most once a second, and never holds up or ends a campaign. `phase` is
that of `Status`; a start that was killed leaves its last one behind, with the process that wrote it
and when (`pid`, `host`, `updated`).
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from pathlib import Path
from typing import Any

from ravenjax.campaign.progress.counts import OnProgress, Status
from ravenjax.store import files, manifest

FILE = "progress.json"
EVERY_S = 1.0
"""Least time between two versions of the same phase."""


class ProgressFile:
    """Keeps progress.json of a folder up to date; call it with each `Status`, which it passes on
    to `then`.
    """

    def __init__(self, folder: Path, then: OnProgress | None = None) -> None:
        self._then = then
        self._path, self._started = folder / FILE, manifest.now()
        self._phase, self._written = "", -EVERY_S

    def __call__(self, status: Status) -> None:
        self._write(status)
        if self._then is not None:
            self._then(status)

    def _write(self, status: Status) -> None:
        now = time.monotonic()
        if status.phase == self._phase and now - self._written < EVERY_S:
            return
        self._phase, self._written = status.phase, now
        with contextlib.suppress(OSError):  # whoever watches waits; the campaign does not
            files.replace(self._path, json.dumps(self.content(status), indent=1) + "\n")

    def content(self, status: Status) -> dict[str, Any]:
        """What the file says."""
        return {
            "phase": status.phase,
            "done": status.done,
            "total": status.total,
            "share_of_this_start": round(status.progress, 6),
            "runs_per_s": status.runs_per_s,
            "eta_s": 0.0 if status.phase == "done" else status.left_s,
            "compile_s": status.compile_s,
            "run_s": status.run_s,
            "parts": status.parts,
            "failed": dict(status.failures),
            "workers": status.workers,
            "engine": status.engine,
            "notes": list(status.notes),
            "started": self._started,
            "updated": manifest.now(),
            "pid": os.getpid(),
            "host": socket.gethostname(),
        }

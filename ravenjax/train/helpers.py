"""The processes beside the realtime loop, started before anything else of a session is imported."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from ravenjax.train import page, recording
from ravenjax.train.processes import Helper


@dataclass(frozen=True)
class SessionHelpers:
    """Processes that import what they need while the session is being prepared."""

    recorder: Helper
    page: Helper | None

    @staticmethod
    def start(stack: contextlib.ExitStack, with_page: bool) -> SessionHelpers:
        """Start them; `stack` ends them."""
        serving = Helper(stack, page.run_when_told) if with_page else None
        return SessionHelpers(Helper(stack, recording.run_when_told), serving)

    def keep_away(self) -> None:
        """Leave the CPU of the realtime loop to that."""
        for helper in (self.recorder, self.page):
            if helper is not None:
                helper.keep_away()

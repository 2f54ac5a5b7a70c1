"""Where the tips came from: the last seconds of the true tip and of the nominal model's, as
lines.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import viser

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.train.page import colours
from ravenjax.train.page.depth_line import add_line_segments, segments_of_path

# 3.6 s altogether.
POINTS, STEP_MS = 90, 40
COLOURS = {"gold": colours.GOLD, "green": colours.GREEN}
DASHED = "green"
"""Differs from the other arm for who sees no colours, too."""
_SAME_M = 1e-5


class Trails:
    """Lines of every arm."""

    def __init__(self, server: viser.ViserServer, arms: tuple[ArmName, ...], blinded: bool) -> None:
        """blinded: the model leaves no trail."""
        self._next_ms = self._last_ms = 0
        self._changed = False
        kinds = {f"{arm}/tip": (COLOURS[arm], 3.5) for arm in arms}
        if not blinded:
            kinds |= {f"{arm}/model": (colours.MODEL, 1.5) for arm in arms}
        self._lines = {
            name: add_line_segments(server, f"/trails/{name}", colour, thickness)
            for name, (colour, thickness) in kinds.items()
        }
        self._points = {name: deque[np.ndarray](maxlen=POINTS) for name in kinds}

    def add(self, arm: ArmName, tip: np.ndarray, model: np.ndarray, ms: int) -> None:
        """Tips in the world, m; taken every STEP_MS."""
        if ms + STEP_MS < self._next_ms:  # the session began anew
            self._next_ms = ms
            for points in self._points.values():
                points.clear()
        if ms < self._next_ms:
            return
        for name, place in ((f"{arm}/tip", tip), (f"{arm}/model", model)):
            points = self._points.get(name)
            if points is not None and not (len(points) == POINTS and _is_still(points, place)):
                self._changed, self._last_ms = True, ms
                points.append(place)

    def send(self) -> None:
        """Draw what was added."""
        if not self._changed:
            return
        self._changed = False
        self._next_ms = self._last_ms + STEP_MS
        for name, points in self._points.items():
            if len(points) > 1:
                segments = segments_of_path(np.stack(points).astype(np.float32))
                self._lines[name].points = segments[::2] if name.startswith(DASHED) else segments


def _is_still(points: deque[np.ndarray], place: np.ndarray) -> bool:
    """Whether the tip has stood here all the time, so that there is nothing new to draw."""
    return all(np.abs(points[i] - place).max() < _SAME_M for i in (0, POINTS // 2, POINTS - 1))

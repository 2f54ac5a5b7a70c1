"""Where the tips came from: the last seconds of the true tip and of the nominal model's, as
lines.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import viser

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.train.page import colours

POINTS = 90
STEP_MS = 40  # 3.6 s altogether
COLOURS = {"gold": colours.GOLD, "green": colours.GREEN}
DASHED = "green"  # apart from the other for who sees no colours, too
_SAME_M = 1e-5


class Trails:
    """Lines of every arm."""

    def __init__(self, server: viser.ViserServer, arms: tuple[ArmName, ...], blinded: bool) -> None:
        """blinded: the model leaves no trail."""
        self._next_ms = self._last_ms = 0
        self._due = False
        self._lines: dict[str, Any] = {}
        self._points: dict[str, deque[np.ndarray]] = {}
        for arm in arms:
            for kind, colour in (
                ("tip", COLOURS[arm]),
                *(() if blinded else (("model", colours.MODEL),)),
            ):
                name = f"{arm}/{kind}"
                self._points[name] = deque(maxlen=POINTS)
                self._lines[name] = server.scene.add_line_segments(
                    f"/trails/{name}",
                    np.zeros((1, 2, 3), np.float32),
                    colour,
                    thickness=3.5 if kind == "tip" else 1.5,
                    thickness_units="screen",
                )

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
            if points is not None and not (len(points) == POINTS and _still(points, place)):
                self._due, self._last_ms = True, ms
                points.append(place.astype(np.float32))

    def send(self) -> None:
        """Draw what was added."""
        if not self._due:
            return
        self._due = False
        self._next_ms = self._last_ms + STEP_MS
        for name, points in self._points.items():
            if len(points) > 1:
                path = np.stack(points)
                pieces = np.stack([path[:-1], path[1:]], axis=1)
                self._lines[name].points = pieces[::2] if name.startswith(DASHED) else pieces


def _still(points: deque[np.ndarray], place: np.ndarray) -> bool:
    """Whether the tip has stood here all the time, so that there is nothing new to draw."""
    return all(np.abs(points[i] - place).max() < _SAME_M for i in (0, POINTS // 2, POINTS - 1))

"""Which instrument is which, and how high: a letter beside each tip, and a plumb line from it
down to the tissue.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import scene
from ravenjax.train.protocol.world import surface

LETTERS = {"gold": "L", "green": "R"}
_LINE = (235, 240, 245)
_SHADE = (20, 16, 16)
_SHADE_M = (0.0022, 0.0006)  # of the spot below the tip
_LETTER_M = np.array([0.0, 0.0, 0.009])  # above the tip
_STILL_M = 2e-5


class Plumb:
    """Letters and lines of every arm; layer /plumb."""

    def __init__(self, server: viser.ViserServer, arms: tuple[ArmName, ...]) -> None:
        self._lines: dict[str, Any] = {}
        self._spots: dict[str, Any] = {}
        self._letters: dict[str, Any] = {}
        self._last: dict[str, np.ndarray] = {}
        for arm in arms:
            self._lines[arm] = server.scene.add_line_segments(
                f"/plumb/{arm}/line",
                np.zeros((1, 2, 3), np.float32),
                _LINE,
                thickness=1.5,
                thickness_units="screen",
                visible=False,
            )
            self._spots[arm] = server.scene.add_cylinder(
                f"/plumb/{arm}/spot",
                *_SHADE_M,
                color=_SHADE,
                opacity=0.6,
                cast_shadow=False,
                receive_shadow=False,
                visible=False,
            )
            self._letters[arm] = server.scene.add_label(
                f"/plumb/{arm}/letter", LETTERS[arm], font_screen_scale=1.6, anchor="bottom-center"
            )

    def show(self, tips: dict[str, np.ndarray]) -> None:
        """Follow the tips, world, m."""
        for arm, tip in tips.items():
            last = self._last.get(arm)
            if last is not None and np.abs(last - tip).max() < _STILL_M:
                continue
            self._last[arm] = tip
            self._letters[arm].position = tip + _LETTER_M
            foot = np.array([tip[0], tip[1], surface(float(tip[0]), float(tip[1]))])
            over = abs(tip[0]) < scene.TISSUE_HALF[0] and abs(tip[1]) < scene.TISSUE_HALF[1]
            for node in (self._lines[arm], self._spots[arm]):
                if node.visible != over:
                    node.visible = over
            if over:
                self._lines[arm].points = np.array([[tip, foot]], np.float32)
                self._spots[arm].position = foot

"""Which instrument is which, and how high: a letter beside each tip, and a dotted line from it
down to the tissue. Layer /plumb.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import scene
from ravenjax.train.protocol.world import surface

LETTERS = {"gold": "L", "green": "R"}
_LINE, _SPOT = (235, 240, 245), (20, 16, 16)
# Radius and height of the spot below the tip, and place of the letter above it, m.
_SPOT_M, _LETTER_M = (0.0022, 0.0006), np.array([0.0, 0.0, 0.009])
_STILL_M = 2e-5


class DepthLine:
    """Letter, line and spot of one arm."""

    def __init__(self, server: viser.ViserServer, arm: ArmName) -> None:
        add, root = server.scene, f"/plumb/{arm}"
        self._line = add_line_segments(server, f"{root}/line", _LINE, 1.5, visible=False)
        self._spot = add.add_cylinder(
            f"{root}/spot",
            *_SPOT_M,
            color=_SPOT,
            opacity=0.6,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._letter = add.add_label(
            f"{root}/letter", LETTERS[arm], font_screen_scale=1.6, anchor="bottom-center"
        )
        self._tip = np.full(3, np.inf)

    def show(self, tip: np.ndarray) -> None:
        """Follow the tip, world, m."""
        if np.abs(self._tip - tip).max() < _STILL_M:
            return
        self._tip = tip
        self._letter.position = tip + _LETTER_M
        foot = np.array([tip[0], tip[1], surface(float(tip[0]), float(tip[1]))])
        is_over = bool(np.all(np.abs(tip[:2]) < scene.TISSUE_HALF[:2]))
        for node in (self._line, self._spot):
            if node.visible != is_over:
                node.visible = is_over
        if is_over:
            self._line.points = np.array([[tip, foot]], np.float32)
            self._spot.position = foot


def add_line_segments(
    server: viser.ViserServer,
    name: str,
    colour: tuple[int, int, int],
    thickness: float,
    points: np.ndarray | None = None,
    **settings: Any,
) -> Any:
    """Line segments [n, 2, 3], m, of a thickness on the screen; one of no length if left out."""
    return server.scene.add_line_segments(
        name,
        np.zeros((1, 2, 3), np.float32) if points is None else points.astype(np.float32),
        colour,
        thickness=thickness,
        thickness_units="screen",
        **settings,
    )


def segments_of_path(path: np.ndarray) -> np.ndarray:
    """The segments [n - 1, 2, 3] between points [n, 3]."""
    return np.stack([path[:-1], path[1:]], axis=1)

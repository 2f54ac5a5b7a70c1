"""The task in the scene: targets to reach, a path to follow, pegs and what they carry.

Of targets the goal is drawn, small the next and, grey, the last that were reached: all at once
would hide the tip. The goal has a colour that neither arm nor model has, and a ring around it that
shrinks as the tip comes nearer.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from ravenjax.train.page.colours import DONE, GOAL

DIM, NEXT, REACHED = (
    0.55,
    0.5,
    0.35,
)  # size of what is not the goal: of pegs, of the next target, of those before
LAST_REACHED = 5
RING_M = (0.004, 0.03)  # least and largest radius
_RING = np.stack(
    [np.cos(np.linspace(0, 2 * np.pi, 49)), np.sin(np.linspace(0, 2 * np.pi, 49)), np.zeros(49)],
    axis=1,
)


class TaskShapes:
    """Nodes of one task, from its geometry: world, m.

    {"targets": [{"number", "at", "radius_m", "colour"}], "pegs": [{"number", "top", "height_m",
    "radius_m", "colour"}], "object": {"number", "at", "radius_m", "colour"} or None, "path":
    {"points", "colour"} or None}; all optional.
    """

    def __init__(self, server: viser.ViserServer, geometry: dict[str, Any]) -> None:
        self._goal: int | None = None
        self._spots: dict[int, tuple[Any, tuple[int, int, int]]] = {}
        self._object: Any = None
        self._held = ""
        self._arms = {
            int(target["number"]): target.get("arm", "") for target in geometry.get("targets") or ()
        }
        self._places: dict[int, np.ndarray] = {}
        self._ring = _ring(server)
        self._on_path: Any = None
        if geometry.get("path"):
            path = geometry["path"]
            _path(server, path)
            self._places = {k: np.asarray(at, float) for k, at in enumerate(path["points"])}
            self._on_path = server.scene.add_icosphere(
                "/task/on_path",
                float(path.get("radius_m", 0.002)),
                color=GOAL,
                opacity=0.55,
                cast_shadow=False,
                receive_shadow=False,
                visible=False,
            )
        for target in geometry.get("targets") or ():
            self._add(server, f"target/{target['number']}", target, target["at"], 0.55)
        for peg in geometry.get("pegs") or ():
            x, y, top = peg["top"]
            height = peg["height_m"]
            server.scene.add_cylinder(
                f"/task/stem/{peg['number']}",
                peg["radius_m"],
                height,
                color=_rgb(peg["colour"]),
                position=(x, y, top - height / 2),
            )
            self._add(server, f"peg/{peg['number']}", peg, peg["top"], 0.7)
        if geometry.get("object"):
            self._object = self._add(
                server, "object", geometry["object"], geometry["object"]["at"], 1.0
            )

    def moved(self, event: dict[str, Any]) -> None:
        """An event of kind "object": an arm took it, or let it go somewhere."""
        self._held = event.get("held", "")
        if self._object is not None and "at" in event:
            self._object.position = tuple(event["at"])

    def show(self, goal: int, tips: dict[str, np.ndarray]) -> None:
        """Mark the present goal, -1: none; what is held goes with the tip, world, m."""
        if self._object is not None and self._held in tips:
            self._object.position = tips[self._held]
        self._surround(goal, tips)
        if goal == self._goal:
            return
        self._goal = goal
        if self._on_path is not None:
            self._on_path.visible = goal in self._places
            self._on_path.position = tuple(self._places.get(goal, np.zeros(3)))
        for number, (node, colour) in self._spots.items():
            if number in self._arms:
                node.visible = goal < 0 or goal - LAST_REACHED <= number <= goal + 1
                node.scale = 1.0 if number == goal else NEXT if number > goal >= 0 else REACHED
                node.color = GOAL if number == goal else colour if number > goal >= 0 else DONE
            else:
                node.color = GOAL if number == goal else colour
                node.scale = 1.0 if number == goal else DIM

    def _surround(self, goal: int, tips: dict[str, np.ndarray]) -> None:
        """A ring around the goal, as wide as the tip is far: the arm's whose turn it is, else
        the nearest.
        """
        place = self._places.get(goal)
        mine = self._arms.get(goal, "")
        ways = [
            np.linalg.norm(tip - place)
            for arm, tip in tips.items()
            if place is not None and mine in ("", arm)
        ]
        if bool(ways) != self._ring.visible:
            self._ring.visible = bool(ways)
        if ways and place is not None:
            self._ring.position = tuple(place)
            self._ring.scale = float(np.clip(min(ways), *RING_M))

    def _add(
        self, server: viser.ViserServer, name: str, spot: dict[str, Any], at: Any, opacity: float
    ) -> Any:
        colour = _rgb(spot["colour"])
        node = server.scene.add_icosphere(
            f"/task/{name}",
            float(spot["radius_m"]),
            color=colour,
            opacity=None if opacity == 1.0 else opacity,
            cast_shadow=False,
            receive_shadow=False,
            position=tuple(at),
        )
        self._spots[int(spot["number"])] = node, colour
        self._places[int(spot["number"])] = np.asarray(at, float)
        return node


def _ring(server: viser.ViserServer) -> Any:
    return server.scene.add_line_segments(
        "/task/ring",
        np.stack([_RING[:-1], _RING[1:]], axis=1).astype(np.float32),
        GOAL,
        thickness=2.0,
        thickness_units="screen",
        visible=False,
    )


def _path(server: viser.ViserServer, path: dict[str, Any]) -> None:
    points = np.asarray(path["points"], np.float32)
    server.scene.add_line_segments(
        "/task/path",
        np.stack([points[:-1], points[1:]], axis=1),
        _rgb(path["colour"]),
        thickness=3.0,
        thickness_units="screen",
    )


def _rgb(colour: str) -> tuple[int, int, int]:
    """Of #rrggbb."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)

"""Draws what is not part of the robot: depth lines down to the tissue, and the task.

Only some targets are drawn: the goal, the next target in a smaller size, and the last targets
reached in grey. All targets at once would hide the tip. The goal has a colour that neither arm nor
model has. The ring around it shrinks as the tip comes nearer.
"""

from typing import Any

import numpy as np
import viser

from ravenjax.train.protocol.messages import Event, Json
from ravenjax.train.protocol.world import tissue_height
from ravenjax.train.robot import ArmName, scene

Rgb = tuple[int, int, int]

# The colours differ from each other also for people who lack one kind of cone. A colour is never
# the only sign: a letter, a shape or dashes say the same. `static/plots.js`, `static/page.css` and
# the debrief's `replay.js` have these colours as #rrggbb.
MODEL = (154, 220, 255)
GOAL = (245, 61, 240)
DONE = (118, 135, 154)
LETTERS = {"gold": "L", "green": "R"}

PLUMB, SPOT = (235, 240, 245), (20, 16, 16)
# Radius and height of the spot below the tip, and position of the letter above it, m.
SPOT_M, LETTER_M = (0.0022, 0.0006), np.array([0.0, 0.0, 0.009])
# Relative sizes of pegs that are not the goal, of the next target, and of targets reached.
OTHER_PEG, NEXT, REACHED = 0.55, 0.5, 0.35
LAST_REACHED = 5
RING_M = (0.004, 0.03)
"""Least and greatest radius."""
_ANGLES = np.linspace(0, 2 * np.pi, 49)
_RING = np.stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(49)], axis=1)
_FLAT: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


class DepthLine:
    """Shows which instrument is which, and how high its tip is.

    A letter is beside the tip, a dotted line leads down to the tissue, and a spot marks its end.
    """

    def __init__(self, server: viser.ViserServer, arm: ArmName) -> None:
        root = f"/plumb/{arm}"
        self._line = add_line_segments(server, f"{root}/line", PLUMB, 1.5, visible=False)
        self._spot = server.scene.add_cylinder(
            f"{root}/spot", *SPOT_M, color=SPOT, opacity=0.6, visible=False, **_FLAT
        )
        self._letter = server.scene.add_label(
            # Each on its own side, so that the letters of two near tips do not overlap.
            f"{root}/letter",
            LETTERS[arm],
            font_screen_scale=1.6,
            anchor="bottom-right" if arm == "gold" else "bottom-left",
        )

    def show(self, tip: np.ndarray) -> None:
        """Follow the tip, world, m."""
        self._letter.position = tip + LETTER_M
        foot = np.array([tip[0], tip[1], tissue_height(float(tip[0]), float(tip[1]))])
        self._line.visible = self._spot.visible = bool(
            np.all(np.abs(tip[:2]) < scene.TISSUE_HALF[:2])
        )
        self._line.points = np.array([[tip, foot]], np.float32)
        self._spot.position = foot


class TaskShapes:
    """Scene nodes of one task, made from its geometry: world, m.

    {"targets": [{"number", "at", "radius_m", "colour"}], "pegs": [{"number", "top", "height_m",
    "radius_m", "colour"}], "object": {"number", "at", "radius_m", "colour"} or None, "path":
    {"points", "colour"} or None}; all optional.
    """

    def __init__(self, server: viser.ViserServer, geometry: Json) -> None:
        self._server = server
        self._goal: int | None = None
        self._spots: dict[int, tuple[Any, Rgb]] = {}
        self._places: dict[int, np.ndarray] = {}
        self._object: Any = None
        self._holder = ""
        targets = geometry.get("targets") or ()
        self._arms = {int(target["number"]): target.get("arm", "") for target in targets}
        ring = segments_of_path(_RING)
        self._ring = add_line_segments(server, "/task/ring", GOAL, 2.0, ring, visible=False)
        self._on_path: Any = None
        if path := geometry.get("path"):
            points = np.asarray(path["points"], float)
            line = segments_of_path(points)
            add_line_segments(server, "/task/path", _rgb(path["colour"]), 3.0, line)
            self._places = dict(enumerate(points))
            self._on_path = self._add_ball("on_path", path["radius_m"], GOAL, 0.55, visible=False)
        for target in targets:
            self._add_spot(f"target/{target['number']}", target, target["at"], 0.55)
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
            self._add_spot(f"peg/{peg['number']}", peg, peg["top"], 0.7)
        if carried := geometry.get("object"):
            self._object = self._add_spot("object", carried, carried["at"], None)

    def follow(self, event: Event) -> None:
        """Take an event of kind "object": an arm took the object, or let it go somewhere."""
        self._holder = event.get("held", "")
        if self._object is not None and "at" in event:
            self._object.position = tuple(event["at"])

    def show(self, goal: int, tips: dict[str, np.ndarray]) -> None:
        """Mark the present goal (-1: none), and move a held object with the tip. tips: world, m."""
        if self._object is not None and self._holder in tips:
            self._object.position = tips[self._holder]
        self._surround(goal, tips)
        if goal == self._goal:
            return
        self._goal = goal
        if self._on_path is not None:
            self._on_path.visible = goal in self._places
            self._on_path.position = tuple(self._places.get(goal, np.zeros(3)))
        for number, (node, colour) in self._spots.items():
            is_goal, is_target = number == goal, number in self._arms
            is_reached = is_target and not number > goal >= 0
            if is_target:
                node.visible = goal < 0 or goal - LAST_REACHED <= number <= goal + 1
            other = REACHED if is_reached else NEXT if is_target else OTHER_PEG
            node.scale = 1.0 if is_goal else other
            node.color = GOAL if is_goal else DONE if is_reached else colour

    def _surround(self, goal: int, tips: dict[str, np.ndarray]) -> None:
        """Draw a ring around the goal whose radius is the distance of the nearest tip in turn."""
        place = self._places.get(goal)
        arms = [arm for arm in tips if self._arms.get(goal, "") in ("", arm)]
        self._ring.visible = place is not None and bool(arms)
        if place is not None and arms:
            self._ring.position = tuple(place)
            distance = min(np.linalg.norm(tips[arm] - place) for arm in arms)
            self._ring.scale = float(np.clip(distance, *RING_M))

    def _add_ball(
        self, name: str, radius: float, colour: Rgb, opacity: float | None, **settings: Any
    ) -> Any:
        return self._server.scene.add_icosphere(
            f"/task/{name}", radius, color=colour, opacity=opacity, **_FLAT, **settings
        )

    def _add_spot(self, name: str, spot: Json, at: Any, opacity: float | None) -> Any:
        colour, number = _rgb(spot["colour"]), int(spot["number"])
        node = self._add_ball(name, spot["radius_m"], colour, opacity, position=tuple(at))
        self._spots[number], self._places[number] = (node, colour), np.asarray(at, float)
        return node


def add_line_segments(
    server: viser.ViserServer,
    name: str,
    colour: Rgb,
    thickness: float,
    points: np.ndarray | None = None,
    **settings: Any,
) -> Any:
    """Add line segments [n, 2, 3], m; by default one of length 0."""
    return server.scene.add_line_segments(
        name,
        np.zeros((1, 2, 3), np.float32) if points is None else points.astype(np.float32),
        colour,
        thickness=thickness,
        thickness_units="screen",
        **settings,
    )


def segments_of_path(path: np.ndarray) -> np.ndarray:
    """Return the segments [n - 1, 2, 3] between points [n, 3]."""
    return np.stack([path[:-1], path[1:]], axis=1)


def _rgb(colour: str) -> Rgb:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue

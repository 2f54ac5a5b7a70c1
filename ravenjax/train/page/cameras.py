"""Each window's own look at the scene: camera presets and layers that it hides."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import viser

from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.train.page.hub import Client
from ravenjax.train.page.server import window
from ravenjax.train.page.world import LAYERS

FIRST = "endoscope"
ENDOSCOPES = {
    "endoscope": (0.0, -0.14, 0.105),
    "endoscope_left": (-0.0027, -0.14, 0.105),
    "endoscope_right": (0.0027, -0.14, 0.105),
    "second": (0.17, -0.03, 0.05),
}
"""Where each stands, m from the middle of the field. The eyes of a stereo endoscope are 5 to 6
mm apart.
"""
LAMP, LAMP_CD = (255, 246, 235), 0.008  # the endoscope's light: colour, candela
FIELD = (0.0, 0.0, 0.192)  # m, its middle: a little above the tissue
ENDOSCOPE_FOV = np.radians(
    44.0
)  # upward; rigid endoscopes see 60 to 75 degrees across their round picture
FAR = "theatre"
"""An inset of it has no letters: from there they would hide the instruments, and each other."""
CAMERAS = (*ENDOSCOPES, "theatre", "front", "closeup")
_FOCUS = {
    "theatre": (0.0, 0.0, 0.37),
    "front": (0.0, 0.0, 0.37),
    "closeup": (0.0, 0.0, 0.198),
}  # m, turned about
_FARTHER = {
    "theatre": 1.25,
    "front": 1.2,
    "closeup": 1.0,
}  # than the model's: a window is narrower than its picture


class Windows:
    """The viser clients, by the name of the window that each belongs to."""

    def __init__(self) -> None:
        self._clients: dict[str, viser.ClientHandle] = {}
        self._layers: dict[str, Any] = {}
        self._lock = threading.Lock()

    def watch(self, server: viser.ViserServer) -> None:
        """Set the scene's look, and know each client that comes."""
        place, focus, fov = pose(FIRST)
        server.initial_camera.position, server.initial_camera.look_at = place, focus
        server.initial_camera.up, server.initial_camera.fov = (0.0, 0.0, 1.0), fov
        server.initial_camera.near = 0.01
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        server.scene.configure_environment_map("studio", environment_intensity=0.3)
        server.scene.configure_default_lights(True, cast_shadow=True)
        lamp = np.array(FIELD) + ENDOSCOPES["endoscope"]
        server.scene.add_light_point(
            "/lamp", color=LAMP, intensity=LAMP_CD, position=tuple(lamp), cast_shadow=False
        )

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            name = window.get() or str(client.client_id)
            self._clients[name] = client
            _, _, inset = name.partition(".")
            if inset in CAMERAS:
                _look(client, inset)
            if inset == FAR:
                self._hide(name, client, "plumb", False)

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            gone = [
                name for name, one in self._clients.items() if one.client_id == client.client_id
            ]
            for name in gone:
                del self._clients[name]
                self._layers = {
                    key: node
                    for key, node in self._layers.items()
                    if not key.startswith(f"{name}/")
                }

    def obey(self, client: Client, told: dict[str, Any]) -> None:
        """A window's wish: {"do": "camera", "name"} or {"do": "layer", "name", "on"}; others are
        ignored.
        """
        handle, name = self._clients.get(client.window), told.get("name")
        if handle is None:
            return
        if told["do"] == "camera" and name in CAMERAS:
            _look(handle, name)
        elif told["do"] == "layer" and name == "shadows":
            handle.scene.configure_default_lights(True, cast_shadow=bool(told.get("on", True)))
        elif told["do"] == "layer" and name in LAYERS:
            self._hide(client.window, handle, name, bool(told.get("on", True)))

    def _hide(self, window: str, handle: viser.ClientHandle, layer: str, on: bool) -> None:
        """A node of this client alone, above the scene's: it hides the layer in this window."""
        key = f"{window}/{layer}"
        if key not in self._layers:
            self._layers[key] = handle.scene.add_frame(f"/{layer}", show_axes=False)
        self._layers[key].visible = on


def _look(client: viser.ClientHandle, name: str) -> None:
    place, focus, fov = pose(name)
    with client.atomic():
        client.camera.position, client.camera.look_at = place, focus
        client.camera.up_direction, client.camera.fov = (0.0, 0.0, 1.0), fov


def pose(name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Position and point looked at, m, and field of view upward, rad: of an endoscope, or of the
    model's camera.
    """
    if name in ENDOSCOPES:
        focus = np.array(FIELD)
        if name.endswith(("_left", "_right")):  # the axes of both eyes are parallel
            focus[0] += ENDOSCOPES[name][0]
            return np.array(FIELD) + ENDOSCOPES[name], focus, float(ENDOSCOPE_FOV)
        return focus + ENDOSCOPES[name], focus, float(ENDOSCOPE_FOV)
    camera = arm_model.scene().camera(name)
    focus = np.array(_FOCUS[name])
    return focus + _FARTHER[name] * (camera.pos - focus), focus, float(np.radians(camera.fovy[0]))

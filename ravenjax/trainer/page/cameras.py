"""Each window's own look at the scene: camera presets and layers that it hides."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import viser

from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.trainer.page.hub import Client
from ravenjax.trainer.page.server import window
from ravenjax.trainer.page.world import LAYERS

CAMERAS = ("theatre", "front", "closeup")
FIRST = "theatre"
_FOCUS = {"theatre": (0.0, 0.0, 0.37), "front": (0.0, 0.0, 0.37), "closeup": (0.0, 0.0, 0.198)}  # m, turned about
_FARTHER = {"theatre": 1.25, "front": 1.2, "closeup": 1.0}  # than the model's: a window is narrower than its picture


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

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            self._clients[window.get() or str(client.client_id)] = client

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            gone = [name for name, one in self._clients.items() if one.client_id == client.client_id]
            for name in gone:
                del self._clients[name]
                self._layers = {key: node for key, node in self._layers.items() if not key.startswith(f"{name}/")}

    def obey(self, client: Client, told: dict[str, Any]) -> None:
        """A window's wish: {"do": "camera", "name"} or {"do": "layer", "name", "on"}; others are ignored."""
        handle, name = self._clients.get(client.window), told.get("name")
        if handle is None:
            return
        if told["do"] == "camera" and name in CAMERAS:
            place, focus, fov = pose(name)
            with handle.atomic():
                handle.camera.position, handle.camera.look_at = place, focus
                handle.camera.up_direction, handle.camera.fov = (0.0, 0.0, 1.0), fov
        elif told["do"] == "layer" and name == "shadows":
            handle.scene.configure_default_lights(True, cast_shadow=bool(told.get("on", True)))
        elif told["do"] == "layer" and name in LAYERS:
            # A node of this client alone, above the scene's: it hides the layer in this window.
            key = f"{client.window}/{name}"
            if key not in self._layers:
                self._layers[key] = handle.scene.add_frame(f"/{name}", show_axes=False)
            self._layers[key].visible = bool(told.get("on", True))


def pose(name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Position and point looked at, m, and field of view upward, rad, of the model's camera."""
    camera = arm_model.scene().camera(name)
    focus = np.array(_FOCUS[name])
    return focus + _FARTHER[name] * (camera.pos - focus), focus, float(np.radians(camera.fovy[0]))

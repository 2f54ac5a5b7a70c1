"""Sets each window's own view of the scene: camera presets and shadows."""

import viser

from ravenjax.robots.raven2.dynamics.scene_views import ENDOSCOPES, FIELD, VIEWS, view_pose
from ravenjax.train.page.hub import Client
from ravenjax.train.page.server import window
from ravenjax.train.protocol.messages import Command

FIRST = "endoscope"
FAR = "theatre"
"""An inset with this view has no letters: they would hide the instruments."""
# The endoscope's light: colour, candela.
LAMP, LAMP_CD = (255, 246, 235), 0.008
UP = (0.0, 0.0, 1.0)


class Windows:
    """The viser clients, by the name of the window to which each belongs."""

    def __init__(self) -> None:
        self._clients: dict[str, viser.ClientHandle] = {}

    def watch(self, server: viser.ViserServer) -> None:
        """Set the scene's look, and register each client that connects."""
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = view_pose(FIRST)
        camera.up, camera.near = UP, 0.01
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        server.scene.configure_environment_map("studio", environment_intensity=0.3)
        server.scene.configure_default_lights(True, cast_shadow=True)
        lamp = tuple(FIELD + ENDOSCOPES[FIRST])
        server.scene.add_light_point(
            "/lamp", color=LAMP, intensity=LAMP_CD, position=lamp, cast_shadow=False
        )

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            name = window.get() or str(client.client_id)
            self._clients[name] = client
            _, _, inset = name.partition(".")
            if inset in VIEWS:
                _look_from(client, inset)
            if inset == FAR:
                # This client's node is the parent of the scene's nodes /plumb/... and hides them.
                client.scene.add_frame("/plumb", show_axes=False, visible=False)

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            for name, known in list(self._clients.items()):
                if known.client_id == client.client_id:
                    del self._clients[name]

    def obey(self, client: Client, message: Command) -> None:
        """Carry out a window's request: {"do": "camera", "name"} or {"do": "shadows", "on"}."""
        handle, name = self._clients.get(client.window), message.get("name")
        if handle is not None and message["do"] == "shadows":
            handle.scene.configure_default_lights(True, cast_shadow=message["on"])
        elif handle is not None and name in VIEWS:
            _look_from(handle, name)


def _look_from(client: viser.ClientHandle, name: str) -> None:
    place, focus, fov = view_pose(name)
    with client.atomic():
        client.camera.position, client.camera.look_at = place, focus
        client.camera.up_direction, client.camera.fov = UP, fov

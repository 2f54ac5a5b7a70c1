"""Shapes of bodies, kept on disk: making them takes seconds, and libraries that nothing else here
needs.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import io
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

from ravenjax.campaign import compile_cache
from ravenjax.engines import trace_key
from ravenjax.robots.raven2.dynamics import body_shapes

_MAKERS = ("mujoco", "mjviser", "trimesh")


class MeshCache:
    """The shapes of one model's bodies."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._objects = model, compile_cache.objects()
        content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        source = Path(body_shapes.__file__).read_bytes()
        self._key = trace_key.of(content, source, [metadata.version(name) for name in _MAKERS])

    def coloured(self, body: int) -> bytes:
        """See `body_shapes.coloured_glb`."""
        return self._cached("coloured", body, lambda: body_shapes.coloured_glb(self._model, body))

    def plain(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Vertices [n, 3], m, and faces [m, 3] of `body_shapes.plain_mesh`."""

        def make() -> bytes:
            mesh, out = body_shapes.plain_mesh(self._model, body), io.BytesIO()
            np.savez(out, vertices=np.asarray(mesh.vertices), faces=np.asarray(mesh.faces))
            return out.getvalue()

        with np.load(io.BytesIO(self._cached("plain", body, make))) as arrays:
            return arrays["vertices"], arrays["faces"]

    def _cached(self, kind: str, body: int, make: Callable[[], bytes]) -> bytes:
        if self._objects is None:
            return make()
        key = trace_key.of(self._key, kind, body)
        content = self._objects.get(key)
        if content is None:
            content = self._objects[key] = make()
        return content

"""Shapes of bodies, made once and kept on disk: that takes seconds, and libraries that nothing
else here needs.
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

_MAKERS = ("mujoco", "mjviser", "trimesh")


class KeptMeshes:
    """The shapes of one model's bodies."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._objects = model, compile_cache.objects()
        content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        source = Path(__file__).with_name("body_meshes.py").read_bytes()
        self._key = trace_key.of(content, source, [metadata.version(name) for name in _MAKERS])

    def coloured(self, body: int) -> bytes:
        """See `body_meshes.coloured`."""

        def make() -> bytes:
            from ravenjax.train.page import body_meshes  # trimesh and SciPy: a second

            return body_meshes.coloured(self._model, body)

        return self._kept("coloured", body, make)

    def plain(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Vertices [n, 3], m, and faces [m, 3] of `body_meshes.plain`."""

        def make() -> bytes:
            from ravenjax.train.page import body_meshes

            mesh, out = body_meshes.plain(self._model, body), io.BytesIO()
            np.savez(out, vertices=np.asarray(mesh.vertices), faces=np.asarray(mesh.faces))
            return out.getvalue()

        with np.load(io.BytesIO(self._kept("plain", body, make))) as arrays:
            return arrays["vertices"], arrays["faces"]

    def _kept(self, kind: str, body: int, make: Callable[[], bytes]) -> bytes:
        if self._objects is None:
            return make()
        place = trace_key.of(self._key, kind, body)
        content = self._objects.get(place)
        if content is None:
            content = self._objects[place] = make()
        return content

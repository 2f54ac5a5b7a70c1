"""Orientations as logs publish them: unit quaternions, or NaN where there is no rotation."""

from __future__ import annotations

import numpy as np


def quaternions(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions x, y, z, w [T, ..., 4] of rotations [T, ..., 3, 3]; NaN where a matrix is no
    rotation.

    A matrix that is a rotation up to rounding, as control software in single precision holds it,
    gives the nearest one. The sign is kept from tick to tick, so that a curve of it has no jumps.
    """
    from scipy.spatial.transform import (
        Rotation,
    )  # half a second; who must not wait calls this once before

    matrices = np.asarray(rotation, float)
    out = np.full((*matrices.shape[:-2], 4), np.nan)
    valid = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    valid[valid] = np.linalg.det(matrices[valid]) > 0.0
    if valid.any():
        out[valid] = Rotation.from_matrix(matrices[valid]).as_quat()
    flips = np.where(np.sum(out[1:] * out[:-1], axis=-1) < 0.0, -1.0, 1.0)
    out[1:] *= np.cumprod(flips, axis=0)[..., None]
    return out

"""An operator's motion: positions of hands and pedal, one row per millisecond. NumPy only.

Positions of hands are in the ITP frame of their arm (`geometry.mapping`), relative to the start of
the motion, and *before* teleoperation scaling: the tip moves by scale times the motion of the hand.
Orientations are not scaled. They are relative to the start, about the axes of the ITP frame.
"""

import dataclasses

import numpy as np

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.vocabulary import TICK_S

NOMINAL_SCALE = 0.1
"""Teleoperation scale for which motions are generated, as in the published fault injections."""
ARM_COLUMNS = ("x_um", "y_um", "z_um", "qx", "qy", "qz", "qw", "grasp_mrad")
"""Columns of one arm in `Motion.table`."""


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """One operator motion of T rows for A arms."""

    name: str
    arms: tuple[ArmName, ...]
    position_um: np.ndarray  # [T, A, 3] hand in the ITP frame, um before scaling
    quat: np.ndarray  # [T, A, 4] x, y, z, w of a unit quaternion
    grasp_mrad: np.ndarray  # [T, A] jaw command relative to the start, positive closes
    surgeon_mode: np.ndarray  # [T] 1 pedal down, 0 up
    start_jpos: tuple[tuple[float, ...], ...]  # per arm, 7 joints in rad and m

    def __len__(self) -> int:
        return len(self.surgeon_mode)

    @property
    def duration_s(self) -> float:
        return len(self) * TICK_S

    def table(self) -> np.ndarray:
        """Return the motion as a table, float32: `ARM_COLUMNS` of each arm, then the pedal."""
        per_arm = np.concatenate([self.position_um, self.quat, self.grasp_mrad[..., None]], axis=2)
        flat = per_arm.reshape(len(self), len(self.arms) * len(ARM_COLUMNS))
        return np.concatenate([flat, self.surgeon_mode[:, None]], axis=1).astype(np.float32)

    def first_rows(self, rows: int) -> "Motion":
        """Return the first `rows` rows of the motion; a shorter motion repeats its last row."""
        index = np.minimum(np.arange(rows), len(self) - 1)
        columns = "position_um", "quat", "grasp_mrad", "surgeon_mode"
        return dataclasses.replace(self, **{name: getattr(self, name)[index] for name in columns})

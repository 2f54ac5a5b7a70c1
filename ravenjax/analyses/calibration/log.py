"""What a log says of one arm: desired and measured joints on the control cycle's clock."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class JointLog(NamedTuple):
    """One arm. Columns are the seven joints: rad, and m for the insertion."""

    start: np.ndarray  # [7] joints where the log begins; nan where it has none
    desired: np.ndarray  # [T, 7], a row a control cycle (1 ms)
    measured: np.ndarray  # [n, 7], by the motors; nan where the log has none
    cycles: np.ndarray  # [n] cycle after which each row was measured

    @property
    def joints(self) -> list[int]:
        """The joints (0 to 6) that it has."""
        return [j for j in range(self.measured.shape[1]) if not np.isnan(self.measured[:, j]).all()]

    def compared(self, begin: int, end: int) -> JointLog:
        """Its cycles up to `end`, of which those before `begin` are replayed but not compared."""
        rows = self.cycles < end
        measured = np.where((self.cycles >= begin)[:, None], self.measured, np.nan)
        return JointLog(self.start, self.desired[:end], measured[rows], self.cycles[rows])

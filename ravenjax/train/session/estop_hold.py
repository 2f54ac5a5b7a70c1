"""What a robot that is stopped is compared with: its nominal model, stopped too.

The tick's model follows the console's clean packets, and a foot that stays on the pedal of a
stopped robot would lead it on: hundreds of millimetres away, with the cue at its cap, toward a
place where nobody asked the robot to be. The rule of a session is therefore: from the first tick of
an E-stop, the robot's own or its software's, until the robot begins anew, the model stands where it
was in that tick; the error is the measured tip's distance from there; there is no force, for a hand
cannot bring a robot back that holds its brakes. It is a rule of what is shown, felt and recorded;
the tick itself is the campaigns', bit for bit.
"""

from __future__ import annotations

import numpy as np

from ravenjax.train.protocol.frame import FrameLayout
from ravenjax.train.robot import E_STOP


class EstopHold:
    """Holds the model in the rows of one robot."""

    def __init__(self, layout: FrameLayout) -> None:
        places = layout.places
        self._runlevel, self._software = places["runlevel"].start, places["soft_estopped"].start
        self._arms = [
            tuple(
                places[f"{arm}/{name}"] for name in ("model_tip", "position", "error_mm", "force")
            )
            for arm in layout.arms
        ]
        names = ("model_jpos", "model_tip")
        held = [places[f"{arm}/{name}"] for arm in layout.arms for name in names]
        self._model = np.r_[*held]
        # Pose of the models as the robot stopped; None: it is not stopped.
        self._pose: np.ndarray | None = None

    def apply(self, row: np.ndarray) -> None:
        """Change a row, float32, of this tick in place."""
        if row[self._runlevel] != E_STOP and not row[self._software]:
            self._pose = None
            return
        if self._pose is None:
            self._pose = row[self._model]
        row[self._model] = self._pose
        for tip, position, error, force in self._arms:
            row[error] = 1e3 * np.linalg.norm(row[position] - row[tip])
            row[force] = 0.0

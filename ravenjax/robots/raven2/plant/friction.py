"""Dry friction as implicit damping, decided anew in each step.

`sign(velocity)` chatters at rest and a smoothed sign creeps. Here each degree of freedom first asks
what force `drive` would be needed, and available, to carry it through the step: `drive = inertia *
v + forces`, all in terms of one step (inertia already divided by the step). If friction can hold
that, the damping becomes so large that the velocity ends at zero within `CREEP`; otherwise it is
the value that makes the friction force equal to its level at the predicted velocity (|drive| -
level) / inertia. The breakaway level is exact, the force always opposes the velocity (it is a
damping), and no iteration is needed.
"""

from __future__ import annotations

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar

CREEP = 1e-7  # rad/s or m/s at most while stuck: 1 um or urad in 10 s

OPPOSES = "friction opposes motion"
"""Why no friction is negative."""


def coulomb_damping(level: Scalar, drive: Scalar, inertia: Scalar) -> Scalar:
    """Damping coefficient of a dry friction of `level` (N m, N) at `drive` (same unit),
    `inertia` (level / speed).
    """
    excess = jnp.maximum(jnp.abs(drive) - level, 0.0)
    return level * inertia / jnp.maximum(excess, inertia * CREEP)

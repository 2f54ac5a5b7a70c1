"""How hard a trainee's instruments pressed on tissue, vessel and each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.train.debrief.course import Course


class ArmContact(NamedTuple):
    """Of one instrument, over the session."""

    arm: str
    peak_n: float  # N, largest force of all that it touched
    impulse_n_s: float  # N s, that force over time
    vessel_n: float  # N, largest force of the vessel
    between_n: float  # N, largest force of the other instrument


def measure(course: Course) -> tuple[ArmContact, ...]:
    """Of each arm of a recorded session; its rows are ms."""
    out = []
    for arm in course.layout.arms:
        force = np.linalg.norm(np.asarray(course.channel(f"{arm}/contact"), float), axis=1)
        vessel, between = (
            float(np.max(course.channel(f"{arm}/{name}"))) for name in ("vessel_n", "between_n")
        )
        out.append(ArmContact(arm, float(force.max()), float(force.sum() * 1e-3), vessel, between))
    return tuple(out)

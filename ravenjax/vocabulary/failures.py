"""Why a run has no valid outcome: the number that was first no longer finite.

A run ends in the outcome class *failed* from the tick on in which a number of the virtual robot or
of its observers is infinite or no number (NaN). Numbers of the control software are the robot's
own, with which it goes on as its original does: they fail a run only where they reach one of these.
"""

from __future__ import annotations

SIGNALS: dict[str, str] = {
    "tip": "the true tip of the robot",
    "model tip": "the tip of the nominal model",
    "deviation": (
        "a distance between tips, or a sum of such distances over the run; also where the golden"
        " run failed"
    ),
    "joint": "a joint or motor of the robot, or the motion of one",
    "cable": "the tension of a cable",
    "hand": "the motion of the operator's hand",
    "contact": "a force between an instrument and what it touches",
    "outcome": "another outcome, at the end of the run",
}
"""What is watched, and what each is; of several in one tick the first of them is named."""

CODES: dict[str, int] = {name: i for i, name in enumerate(SIGNALS)}

CAUSES: tuple[str, ...] = ("", *(f"{name} not finite" for name in SIGNALS))
"""Words of column `failed`, "" for a valid outcome; those of engines are numbered from 0 behind
it.
"""

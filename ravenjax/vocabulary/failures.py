"""Reasons why a run has no valid outcome: the number that was the first to be no longer finite.

A run is *failed* from the tick on in which a number of the virtual robot or of its observers is
infinite or NaN. Numbers of the control software may be infinite or NaN without failing the run: the
software continues with them, as its original does. They fail the run only if they reach the robot
or its observers.
"""

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
"""The watched signals and their descriptions. Of several that fail in one tick, the first is
reported.
"""

CODES: dict[str, int] = {name: i for i, name in enumerate(SIGNALS)}

CAUSES: tuple[str, ...] = ("", *(f"{name} not finite" for name in SIGNALS))
"""Words of column `failed`; "" means a valid outcome. The causes of engines are numbered after
these.
"""

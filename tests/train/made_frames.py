"""Frames of a session that runs well, to be changed by tests; and scenarios of a line or two."""

import numpy as np

from ravenjax.campaign.faults import design
from ravenjax.robots.raven2.geometry.instrument import JAW_LENGTH
from ravenjax.train import scenario
from ravenjax.train.protocol import (
    PHASES,
    Frame,
    FrameLayout,
    closing_point,
    frame0_in_world,
    jaw_direction,
)

HOME = (-0.07794699817895889, -0.02526555210351944, 0.013225629925727844)
AXES = {"gold": HOME, "green": (HOME[0], -HOME[1], HOME[2])}
"""m, frame 0: the jaws' axes in the home pose."""
JPOS = (0.5, 1.6, 0.4, 0.0, 0.0, 0.785, 0.785)
TIPS = {arm: closing_point(arm, axis, JPOS) for arm, axis in AXES.items()}
"""m, frame 0: where the jaws close there."""
FAULT = [
    {"site": "usb_out", "channel": "elbow", "effect": "offset", "value": 700, "duration_ms": 2000}
]


def running(arms=("gold",)):
    """A frame of a session at work: pedal down, the robot follows, no force."""
    frame = Frame(FrameLayout.of(arms))
    for name, value in {
        "phase": PHASES.index("running"),
        "runlevel": 3,
        "live": 1,
        "pedal": 1,
        "console_alive": 1,
        "cue_on": 1,
        "hazard": -1,
    }.items():
        frame[name] = value
    for arm in arms:
        frame[f"{arm}/tip"] = AXES[arm]
        frame[f"{arm}/link_jpos"] = JPOS
        frame[f"{arm}/depth_mm"] = -20.0
    return frame


def from_world(arm, point):
    """A point of the world in the arm's frame 0, m."""
    origin, rows = frame0_in_world(arm)
    return (np.subtract(point, origin) @ np.array(rows)).tolist()


def put(frame, arm, point):
    """Put the jaws where they close at a point of the world, m."""
    way = jaw_direction(arm, frame[f"{arm}/link_jpos"].tolist())
    frame[f"{arm}/tip"] = [
        x - JAW_LENGTH * w for x, w in zip(from_world(arm, point), way, strict=True)
    ]


def made(**keys):
    """A scenario of these keys and its hazards, seed 0."""
    chosen = scenario.from_dict({"name": "made", "duration_s": 60, **keys})
    return chosen, scenario.armable_hazards(
        chosen, design.table_columns(scenario.session_campaign(chosen, 0))
    )


def kinds(events):
    return [event["kind"] for event in events]

"""Names of CRTK: arms, joints, frames, topics with their types."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.train.robot_link.crtk import messages

ARM_NAMES: dict[ArmName, str] = {"gold": "arm1", "green": "arm2"}
"""As raven2's own CRTK interface has them."""
CONSOLE = "console"


class RosTopic(NamedTuple):
    """What is told or heard under one name."""

    name: str  # without a slash before it
    kind: str  # of `messages`
    latched: bool = False  # who comes later hears the last one too
    as_published: bool = (
        False  # versions of the type differ: its publisher says how it is defined (ROS 1)
    )


def frame_id(arm: ArmName) -> str:
    """The frame in which poses of an arm are told, see `frames`."""
    return f"{ARM_NAMES[arm]}_base"


def arm_topic(arm: ArmName, word: str) -> str:
    """Such as `arm1/measured_js`."""
    return f"{ARM_NAMES[arm]}/{word}"


def published(
    arms: Sequence[ArmName], raven_state: bool = False, contact: bool = False
) -> list[RosTopic]:
    """What a robot with these arms tells.

    raven_state: in raven2's message too. contact: its force on what it touches.
    """
    topics = [RosTopic("operating_state", messages.OPERATING_STATE, latched=True)]
    for arm in arms:
        topics += [
            RosTopic(arm_topic(arm, "operating_state"), messages.OPERATING_STATE, latched=True)
        ]
        joints = ("measured_js", "setpoint_js", "jaw/measured_js", "jaw/setpoint_js")
        topics += [RosTopic(arm_topic(arm, word), messages.JOINT_STATE) for word in joints]
        topics += [
            RosTopic(arm_topic(arm, word), messages.POSE) for word in ("measured_cp", "setpoint_cp")
        ]
        topics += [RosTopic(arm_topic(arm, "measured_cv"), messages.TWIST)]
        topics += [RosTopic(arm_topic(arm, "cue_cf"), messages.WRENCH)]
        if contact:
            topics += [RosTopic(arm_topic(arm, "measured_cf"), messages.WRENCH)]
    if raven_state:
        topics.append(RosTopic("ravenstate", messages.RAVEN_STATE))
    return topics


SERVO = ("servo_cp", "servo_jp", "servo_jr", "jaw/servo_jp")
"""Words of commands that are sent again and again, and are old soon."""


def subscribed(arms: Sequence[ArmName]) -> list[RosTopic]:
    """What a robot with these arms hears."""
    topics = [
        RosTopic("state_command", messages.STRING),
        RosTopic(f"{CONSOLE}/operator_present", messages.JOY),
        RosTopic(f"{CONSOLE}/clutch", messages.JOY),
    ]
    for arm in arms:
        topics += [RosTopic(arm_topic(arm, "state_command"), messages.STRING)]
        topics += [RosTopic(arm_topic(arm, "servo_cp"), messages.POSE)]
        joints = ("servo_jp", "servo_jr", "move_jp", "jaw/servo_jp")
        topics += [RosTopic(arm_topic(arm, word), messages.JOINT_STATE) for word in joints]
    return topics


def reported(arms: Sequence[ArmName], raven_state: bool) -> list[RosTopic]:
    """What another robot with these arms tells of itself: raven2's own message, or CRTK's."""
    if raven_state:
        return [RosTopic("ravenstate", messages.RAVEN_STATE, as_published=True)]
    topics: list[RosTopic] = []
    for arm in arms:
        topics += [
            RosTopic(arm_topic(arm, word), messages.JOINT_STATE)
            for word in ("measured_js", "setpoint_js")
        ]
        topics += [
            RosTopic(arm_topic(arm, "operating_state"), messages.OPERATING_STATE, latched=True)
        ]
    return topics

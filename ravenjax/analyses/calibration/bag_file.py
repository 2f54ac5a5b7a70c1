"""Logs of ROS 1 and ROS 2 as tables: .bag, .mcap, .db3 and folders of ROS 2 with a metadata.yaml.

- raven2's `raven_2/raven_state`, on /ravenstate: jpos and jpos_d of both arms in its slots, all
  times 180/pi, the insertion too; the definition is taken from the file;
- CRTK's `/arm1/measured_js` and `/arm1/setpoint_js` (arm1 is gold, arm2 green),
  sensor_msgs/JointState in rad and m. raven2 publishes what it measures of one arm under the
  other's name (branch crtk, src/raven/local_io.cpp), so that the measured joints of an arm are
  those that follow its setpoint.

Times are the headers', or those of arrival where the headers have none. Of a cut or damaged file
nothing is read.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.errors import UserError, listed
from ravenjax.robots.raven2.arms import ARMS, JOINTS, ArmName
from ravenjax.store.logs.bags import TopicMessages, open_bag, read_topic
from ravenjax.store.logs.topics import ARM_TOPICS

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".mcap", ".db3")
STATE, JOINT_STATE = "/raven_state", "/JointState"  # ends of types: ROS 2 has /msg in between
SLOTS = np.array([0, 1, 2, 4, 5, 6, 7])
"""Of the eight numbers that raven_state has of an arm, those of joints; the fourth is of none."""
PER_STATE = np.pi / 180.0
"""rad and m per unit of raven_state."""


class _Series(NamedTuple):
    """The joints that one topic tells of."""

    time_ns: np.ndarray  # int64 [n] since the epoch
    joints: np.ndarray  # [n, 7], rad and m; nan where the messages have no such joint


def table(path: Path, arm: ArmName) -> pd.DataFrame:
    """Columns time_s, jpos_d_JOINT and jpos_JOINT, rad and m; of raven_state runlevel, too.
    UserError.
    """
    with open_bag(path) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        for topic, kind in kinds.items():
            if kind.endswith(STATE):
                return _of_states(read_topic(path, reader, topic), arm)
        wanted = {
            f"/{ARM_TOPICS[name]}/{topic}": name
            for name in ARMS
            for topic in ("measured_js", "setpoint_js")
        }
        topics = {
            end: topic
            for topic, kind in kinds.items()
            for end in wanted
            if f"/{topic}".endswith(end) and kind.endswith(JOINT_STATE)
        }
        setpoint = f"/{ARM_TOPICS[arm]}/setpoint_js"
        measured = [topics[end] for end in topics if end.endswith("measured_js")]
        if setpoint not in topics or not measured:
            raise UserError(
                f"{path}: expected raven2's state, or {setpoint} and measured_js of CRTK; the file"
                " has\n"
                + listed(
                    [f"{topic} ({kind})" for topic, kind in sorted(kinds.items())] or ["no topics"]
                )
            )
        followed = _joints(path, reader, topics[setpoint])
        return _following(followed, [_joints(path, reader, topic) for topic in measured])


def _following(setpoint: _Series, candidates: list[_Series]) -> pd.DataFrame:
    """The candidate nearest to the setpoint, on its own times."""
    pairs = [_on_times(setpoint, one) for one in candidates]
    apart = [np.nanmean(np.abs(desired - measured.joints)) for desired, measured in pairs]
    desired, measured = pairs[int(np.argmin(apart))]
    return _columns(measured.time_ns, desired, measured.joints)


def _on_times(setpoint: _Series, measured: _Series) -> tuple[np.ndarray, _Series]:
    """Setpoint [n, 7] where the joints were measured, and those; only the times at which both
    are known.
    """
    begin, end = setpoint.time_ns[[0, -1]]
    common = (measured.time_ns >= begin) & (measured.time_ns <= end)
    time_ns = measured.time_ns[common]
    desired = [
        np.interp(time_ns - begin, setpoint.time_ns - begin, column) for column in setpoint.joints.T
    ]
    return np.stack(desired, axis=1), _Series(time_ns, measured.joints[common])


def _of_states(states: TopicMessages, arm: ArmName) -> pd.DataFrame:
    slots = SLOTS + 8 * ARMS.index(arm)
    desired, measured = (
        np.array([getattr(one, name)[slots] for one in states.messages], float) * PER_STATE
        for name in ("jpos_d", "jpos")
    )
    columns = _columns(_times(states), desired, measured)
    return columns.assign(runlevel=[int(one.runlevel) for one in states.messages])


def _joints(path: Path, reader: AnyReader, topic: str) -> _Series:
    """A topic of sensor_msgs/JointState: by names as ravenjax writes them, else seven in the
    order of the joints.
    """
    states = read_topic(path, reader, topic)
    first = states.messages[0]
    names = list(first.name)
    places = [names.index(word) if word in names else None for word in JOINTS]
    if all(place is None for place in places):
        if len(first.position) != len(JOINTS):
            raise UserError(
                f"{path}: {topic} has {len(first.position)} joints, {', '.join(names)};"
                f" expected some of {', '.join(JOINTS)}, or seven in this order"
            )
        places = list(range(len(JOINTS)))
    joints = np.full((len(states.messages), len(JOINTS)), np.nan)
    for joint, place in enumerate(places):
        if place is not None:
            joints[:, joint] = [one.position[place] for one in states.messages]
    return _Series(_times(states), joints)


def _times(states: TopicMessages) -> np.ndarray:
    """Times of messages, ns since the epoch [n]: of the headers, if they have any that run."""
    return states.stamped_ns if states.stamps_run else states.arrived_ns


def _columns(time_ns: np.ndarray, desired: np.ndarray, measured: np.ndarray) -> pd.DataFrame:
    columns = {"time_s": (time_ns - time_ns[:1]) * 1e-9}
    for joint, word in enumerate(JOINTS):
        columns |= {f"jpos_d_{word}": desired[:, joint], f"jpos_{word}": measured[:, joint]}
    return pd.DataFrame(columns).dropna(axis="columns", how="all")

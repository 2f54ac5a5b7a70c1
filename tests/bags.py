"""Bags of ROS 1 and ROS 2 as a robot's recorder writes them, by the writers of the rosbags
library.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STATE = "raven_2/msg/raven_state"
FIELDS = """Header hdr
int32 runlevel
int32 sublevel
int32 last_seq
int32[2] type
int32[6] pos
float32[18] ori
float32[18] ori_d
int32[6] pos_d
duration dt
int32[16] encVals
float32[16] dac_val
float32[16] tau
float32[16] mpos
float32[16] jpos
float32[16] mvel
float32[16] jvel
float32[16] mpos_d
float32[16] jpos_d
float32[2] grasp_d
float32[16] encoffsets
float32[12] jac_vel
float32[12] jac_f
"""
"""What raven2's state has, as the specification lists it."""
CRTK_NAMES = ("shoulder", "elbow", "ins", "roll", "wrist", "jaw1", "jaw2")
SLOTS = [0, 1, 2, 4, 5, 6, 7]
EPOCH_NS = 1_700_000_000_000_000_000
DELAY_NS = 250_000_000  # from stamp to arrival


class Motion(NamedTuple):
    """One arm."""

    seconds: np.ndarray  # [n] from the first
    desired: np.ndarray  # [n, 7] rad and m
    measured: np.ndarray  # [n, 7]


def state_bag(
    path: Path, gold: Motion, green: Motion, runlevel: ArrayLike = 3, stamped: bool = True
) -> Path:
    """ROS 1: /ravenstate of both arms; runlevel: one for all, or [n]."""
    runlevels = np.broadcast_to(runlevel, len(gold.seconds))
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(FIELDS, STATE))
    kinds = dict(store.fielddefs[STATE][1])

    def messages() -> Iterator[tuple[str, int, Any]]:
        for row, seconds in enumerate(gold.seconds):
            filled = {name: _empty(store, kind) for name, kind in kinds.items()}
            filled["hdr"] = _header(store, seconds if stamped else 0.0, stamped)
            filled["runlevel"] = int(runlevels[row])
            for name in ("desired", "measured"):
                values = np.zeros(16)
                for arm, motion in enumerate((gold, green)):
                    values[np.array(SLOTS) + 8 * arm] = np.degrees(getattr(motion, name)[row])
                filled["jpos_d" if name == "desired" else "jpos"] = values.astype(np.float32)
            yield "/ravenstate", _ns(seconds), store.types[STATE](**filled)

    return _ros1(path, store, {"/ravenstate": STATE}, messages)


def crtk_bag(
    path: Path,
    gold: Motion,
    green: Motion,
    ros: int = 1,
    swapped: bool = False,
    change: Callable[[list[str], Any], Any] | None = None,
) -> Path:
    """CRTK of both arms. ros: 1; or 2, an MCAP folder. swapped: measured_js under the other's
    name, as raven2 does. change: of names and positions of gold's setpoint 20.
    """
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    arms = {"arm1": (gold, green if swapped else gold), "arm2": (green, gold if swapped else green)}

    def messages() -> Iterator[tuple[str, int, Any]]:
        for row, seconds in enumerate(gold.seconds):
            for name, (setpoint, measured) in arms.items():
                for topic, joints in (
                    ("setpoint_js", setpoint.desired),
                    ("measured_js", measured.measured),
                ):
                    names = [
                        f"{'gold' if name == 'arm1' else 'green'}_{word}" for word in CRTK_NAMES
                    ]
                    position = joints[row]
                    if change and (row, name, topic) == (20, "arm1", "setpoint_js"):
                        names, position = change(names, position)
                    numbers = [position, np.zeros(7), np.zeros(7)]
                    message = store.types[kind](_header(store, seconds), names, *numbers)
                    yield f"/{name}/{topic}", _ns(seconds), message

    topics = {f"/{name}/{topic}": kind for name in arms for topic in ("setpoint_js", "measured_js")}
    return (_ros1 if ros == 1 else _ros2)(path, store, topics, messages)


def pose_bag(
    path: Path,
    namespace: str,
    seconds: np.ndarray,
    place: np.ndarray,
    frame: str = "",
    jaws: str = "none",
    first_ns: int = EPOCH_NS,
    jaws_late_s: float = 0.0,
) -> Path:
    """ROS 1: CRTK's setpoint_cp at `place` [n, 3] m. jaws: "raven2" in setpoint_js, "alone" in
    jaw/setpoint_js, where setpoint_js has six joints; or "none".

    first_ns: the first stamp. jaws_late_s: delay of the stamps of joints.
    """
    store = get_typestore(Stores.ROS1_NOETIC)
    pose, joints = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"
    topics = {f"{namespace}/setpoint_cp": pose}
    if jaws != "none":
        topics |= {f"{namespace}/setpoint_js": joints}
    if jaws == "alone":
        topics |= {f"{namespace}/jaw/setpoint_js": joints}
    names = {"setpoint_js": [f"gold_{word}" for word in CRTK_NAMES], "jaw/setpoint_js": ["jaw"]}
    if jaws == "alone":
        names["setpoint_js"] = names["setpoint_js"][:5]

    def messages() -> Iterator[tuple[str, int, Any]]:
        point, turn = (store.types[f"geometry_msgs/msg/{one}"] for one in ("Point", "Quaternion"))
        for row, (at, where) in enumerate(zip(seconds, place, strict=True)):
            header = _header(store, at, frame=frame)
            if row == 0:
                header.stamp.sec, header.stamp.nanosec = divmod(first_ns, 10**9)
            body = store.types["geometry_msgs/msg/Pose"](point(*where), turn(0.0, 0.0, 0.0, 0.0))
            yield f"{namespace}/setpoint_cp", _ns(at), store.types[pose](header, body)
            for topic in topics:
                if (words := names.get(topic.removeprefix(f"{namespace}/"))) is not None:
                    numbers = [np.full(len(words), 0.4), np.zeros(0), np.zeros(0)]
                    header = _header(store, at + jaws_late_s)
                    yield topic, _ns(at), store.types[joints](header, words, *numbers)

    return _ros1(path, store, topics, messages)


def _ros1(
    path: Path, store: Any, topics: dict[str, str], messages: Callable[[], Iterator[Any]]
) -> Path:
    with Ros1Writer(path) as writer:
        channels = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in topics.items()
        }
        for topic, time_ns, message in messages():
            writer.write(channels[topic], time_ns, store.serialize_ros1(message, topics[topic]))
    return path


def _ros2(
    path: Path, store: Any, topics: dict[str, str], messages: Callable[[], Iterator[Any]]
) -> Path:
    with Ros2Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        channels = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in topics.items()
        }
        for topic, time_ns, message in messages():
            writer.write(channels[topic], time_ns, store.serialize_cdr(message, topics[topic]))
    return path


def _ns(seconds: float) -> int:
    """When a message arrived."""
    return EPOCH_NS + DELAY_NS + round(seconds * 1e9)


def _header(store: Any, seconds: float, stamped: bool = True, frame: str = "") -> Any:
    time_ns = EPOCH_NS + round(seconds * 1e9) if stamped else 0
    stamp = store.types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
    header = store.types["std_msgs/msg/Header"]
    return header(0, stamp, frame) if "seq" in header.__dataclass_fields__ else header(stamp, frame)


def _empty(store: Any, kind: Any) -> Any:
    """A field without content: a number, numbers, or a duration."""
    node, inner = kind
    if node.name == "ARRAY":
        return np.zeros(inner[1], np.dtype(inner[0][1][0]))
    if node.name == "NAME" and inner.endswith("Duration"):
        return store.types[inner](0, 0)
    return 0

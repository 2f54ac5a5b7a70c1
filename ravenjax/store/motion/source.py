"""Reads tables and bags of robots and of operators' hands, with uniform names of columns.

The manual page `docs/how-to/recordings.md` lists columns and topics. Replays of operators and the
calibration of robots read their files with this module, so the same checks apply.
"""

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ravenjax import resources
from ravenjax.errors import UserError, suggest_name
from ravenjax.robots.raven2.arms import JOINTS, ArmName
from ravenjax.store import files
from ravenjax.store.logs import bags
from ravenjax.store.logs.bags import TopicMessages
from ravenjax.store.logs.topics import ARM_TOPICS, JOINT_STATE, POSE, frame0_name
from ravenjax.store.motion import stamps
from ravenjax.store.motion.options import Frame, ReplayOptions, of_arm
from ravenjax.store.motion.summary import list_names
from ravenjax.store.motion.track import LENGTHS, WIDEST_RAD, ArmTrack, Track

if TYPE_CHECKING:
    import pandas as pd
    from rosbags.highlevel import AnyReader

ANGLES = {"rad": 1e3, "mrad": 1.0, "deg": 1e3 * math.pi / 180.0}
"""Factors from a unit of angle to mrad."""
PEDAL = "surgeon_mode"
SOURCES = ("setpoint", "measured")
"""Prefixes of the bag topics from which a motion is read, in order of preference."""
MATRIX = tuple(f"r{row}{column}" for row in "123" for column in "123")
QUAT = tuple(f"q{axis}" for axis in "xyzw")
JIGSAWS = resources.read_tables(__file__, "source.toml")["jigsaws"]
"""Column names for kinematics files of the data set JIGSAWS. The left instrument is gold."""
JAWS_OF_JIGSAWS = (
    "JIGSAWS does not state in which direction its jaw angles open the jaws; here a larger angle"
    " is a wider opening"
)


@dataclasses.dataclass(eq=False)
class Samples:
    """Columns of recorded numbers, and the times of their samples."""

    path: Path
    # The index gives the number of the row in the file, or of the message in the topic.
    table: "pd.DataFrame"
    clock: str = ""  # name of the column or clock that the times come from
    time_s: np.ndarray | None = None  # [T]
    topic: str = ""  # topic in a bag; "" for a table
    notes: tuple[str, ...] = ()
    read: list[str] = dataclasses.field(default_factory=list)  # columns that were used

    def place(self, row: int) -> str:
        """Return text that identifies a row in error messages."""
        number = self.table.index[row]
        return f"message {number} of {self.topic}" if self.topic else f"row {number}"

    def numbers(self, name: str) -> np.ndarray:
        """Return the numbers of a column, integers as integers.

        Raise UserError if a row has no finite number; the message names the first such row.
        """
        import pandas as pd

        self.read.append(name)
        values = np.asarray(self.table[name])
        if values.dtype.kind in "iu":
            return values
        # Dates and durations ("mM") are refused: as numbers they would be in another unit (ns).
        numbers = np.full(len(values), np.nan)
        if values.dtype.kind not in "mM":
            numbers = np.asarray(pd.to_numeric(self.table[name], errors="coerce"), float)
        if (bad := np.flatnonzero(~np.isfinite(numbers))).size:
            raise UserError(
                f"{self.path}: {self.place(bad[0])}, column {name}: got {values[bad[0]]}, expected"
                f" a finite number ({bad.size} such rows). Remove these rows, or write a number of"
                f" {name} into each"
            )
        return numbers

    def quantity(self, name: str, units: Mapping[str, float]) -> np.ndarray | None:
        """Return the column `name`_<unit> in the base unit; None if no such column exists.

        units: factor from each unit to the base unit; "" is the unit of a column called `name`.
        Angles in degrees that could be radians add a note.
        """
        factors = {f"{name}_{unit}".rstrip("_"): factor for unit, factor in units.items()}
        names = [column for column in factors if column in self.table]
        if len(names) > 1:
            raise UserError(f"{self.path}: columns {' and '.join(names)} mean the same; keep one")
        if not names:
            return None
        numbers = self.numbers(names[0])
        stem, _, unit = names[0].rpartition("_")
        # Half a turn, 180 degrees, would be pi in radians.
        if unit == "deg" and 0 < (largest := np.abs(numbers).max(initial=0)) <= math.pi:
            note = f"{names[0]} is at most {largest:.3g}; if these are radians, name the column"
            self.notes = (*self.notes, f"{note} {stem}_rad" if "rad" in units else f"{note} {stem}")
        return numbers * factors[names[0]]

    def times(self, options: ReplayOptions) -> np.ndarray | None:
        """Return the times of the samples [T], s; None if they are evenly spaced by the options.

        Raise UserError as `stamps.sample_times`.
        """
        time_s, self.clock, notes = stamps.sample_times(
            self.path, self.clock, self.time_s, len(self.table), options
        )
        self.notes = (*self.notes, *notes)
        return time_s

    def group(self, names: Sequence[str], what: str) -> np.ndarray | None:
        """Return k columns that belong together as [T, k]; None if all are missing."""
        missing = [name for name in names if name not in self.table]
        if len(missing) == len(names):
            return None
        if missing:
            raise UserError(
                f"{self.path}: {what} needs {', '.join(names)}; {', '.join(missing)} missing"
            )
        return np.stack([*map(self.numbers, names)], axis=1)


def read_table(path: Path, options: ReplayOptions, header: str) -> Samples:
    """Return the columns of a table under ravenjax's names for them, and the times of its rows.
    header: a header line that error messages propose.
    """
    given = JIGSAWS if options.columns == "jigsaws" else options.columns
    # A dictionary (ravenjax's name -> the file's name), or the names of all columns.
    file_names, all_names = (given, ()) if isinstance(given, dict) else ({}, given)
    names = [name.strip(" -") or f"column {i}" for i, name in enumerate(all_names)]
    way = f"{header}, or name all columns: {options.written('columns', header.split(','))}"
    if "gold" in header:
        way += f'. The {len(JIGSAWS)} columns of JIGSAWS are operator.columns = "jigsaws"'
    table = files.read_table(path, names or None, way)
    new_names = {file_name: name for name, file_name in file_names.items()}
    for file_name, name in new_names.items():
        if file_name not in table:
            raise UserError(
                f"{path}: no column {file_name!r}, from which {options.written('columns', '...')}"
                f" takes {name}; the file has {list_names(table)}"
                f"{suggest_name(file_name, map(str, table))}"
            )
    replaced = [name for name in file_names if name in table and name not in new_names]
    table = table.drop(columns=replaced).rename(columns=new_names)
    if len(table) < 2:
        content = f"contains {len(table)} rows" if len(table) else "the table has no rows"
        raise UserError(f"{path}: {content}; expected at least 2 rows")
    notes = (JAWS_OF_JIGSAWS,) if options.columns == "jigsaws" else ()
    notes = (*notes, *table.attrs.get("notes", ()))
    samples = Samples(path, table, notes=notes)
    times = stamps.time_columns(table)
    if len(times) > 1:
        raise UserError(f"{path}: columns {' and '.join(times)} mean the same; keep one of them")
    for name in times:
        samples.clock = f"column {name}"
        values = stamps.times_since_first(samples.numbers(name))
        samples.time_s = values * stamps.UNITS[name.rpartition("_")[2]]
    return samples


def read_track(path: Path, arms: tuple[ArmName, ...], options: ReplayOptions) -> Track:
    """Return the recorded motion of `arms`. Raise UserError if it cannot be used; the message names
    the row or bag message with the problem.
    """
    if bags.is_bag(path):
        return _bag_track(path, arms, options)
    whole = read_table(path, options, "time_s,gold_x_um,gold_y_um,gold_z_um")
    samples = {arm: _of_sensor(whole, arm, options.sensors) for arm in arms}
    tracks: dict[str, ArmTrack] = {arm: _arm_track(samples[arm], arm, options) for arm in arms}
    pedal, first = None, samples[arms[0]]
    if PEDAL in whole.table:
        pedal = first.numbers(PEDAL)
        if (bad := np.flatnonzero((pedal != 0.0) & (pedal != 1.0))).size:
            raise UserError(
                f"{path}: {first.place(bad[0])}, column {PEDAL}: got {pedal[bad[0]]:g}, expected 1"
                " (pedal down) or 0"
            )
    used = {name for columns in (whole, *samples.values()) for name in columns.read}
    if options.rate_hz is not None:
        used -= set(stamps.time_columns(used))
    names = list(dict.fromkeys(str(name) for one in samples.values() for name in one.table))
    return Track(
        path=path,
        clock=first.clock,
        arms=tracks,
        surgeon_mode=pedal,
        read=tuple(name for name in names if name in used),
        ignored=tuple(name for name in names if name not in used),
        notes=first.notes,
    )


def _of_sensor(whole: Samples, arm: str, sensors: Mapping[str, str | int]) -> Samples:
    """Return one arm's rows, with columns such as gold_x_mm for x_mm; without sensors, all rows."""
    if not sensors:
        return dataclasses.replace(whole, read=list(whole.read))
    column, sensor = sensors.get("column", ""), sensors.get(arm)
    if column not in whole.table or sensor is None:
        raise UserError(
            f"{whole.path}: operator.sensors must name the column with the sensors, and the sensor"
            f" of {arm}, such as {{ column = 'tool', {arm} = 'left' }}. The file has the columns"
            f" {list_names(whole.table)}"
        )
    # pandas reads whole numbers as 1.0, 2.0 if a cell of the column is empty.
    sensor_of_row = whole.table[column].astype(str).str.strip().str.removesuffix(".0")
    rows = np.asarray(sensor_of_row == str(sensor))
    if rows.sum() < 2:
        raise UserError(
            f"{whole.path}: column {column} has {sensor!r} in {rows.sum()} rows; expected at least"
            f" 2 rows. Its values are {list_names(sorted(set(sensor_of_row)))}"
        )
    quantities = {f"{axis}_{unit}" for axis in "xyz" for unit in LENGTHS}
    quantities |= {*QUAT, *MATRIX, *(f"grasp_{unit}" for unit in ANGLES)}
    names = {name: f"{arm}_{name}" for name in quantities}
    table = whole.table.loc[rows].rename(columns=names)
    time_s = None if whole.time_s is None else whole.time_s[rows]
    return dataclasses.replace(whole, table=table, time_s=time_s, read=[*whole.read, column])


def _arm_track(samples: Samples, arm: ArmName, options: ReplayOptions) -> ArmTrack:
    # Reads one arm's positions, orientations and jaws from the columns of a table.
    path, table = samples.path, samples.table
    coordinates = []
    for name in (f"{arm}_{axis}" for axis in "xyz"):
        values = samples.quantity(name, LENGTHS)
        if values is None:
            columns = " or ".join(f"{name}_{unit}" for unit in LENGTHS)
            raise UserError(
                f"{path}: no column {columns}; the file has {list_names(table)}. Name the column:"
                f" operator.columns = {{ {name}_mm = '...' }}. If each arm has its own rows, name"
                f" them: operator.sensors = {{ column = 'tool', {arm} = 'left' }}, for example"
            )
        coordinates.append(values)
    quat = samples.group([f"{arm}_{name}" for name in QUAT], "an orientation")
    matrix = samples.group([f"{arm}_{name}" for name in MATRIX], "a rotation matrix")
    return ArmTrack(
        samples.times(options),
        np.stack(coordinates, axis=1),
        _unit_quaternions(samples, arm, quat, matrix),
        samples.quantity(f"{arm}_grasp", ANGLES),
    )


def _unit_quaternions(
    samples: Samples, arm: str, quat: np.ndarray | None, matrix: np.ndarray | None
) -> np.ndarray | None:
    """Return unit quaternions [T, 4] from recorded quaternions or from rotation matrices [T, 9].
    Return None if neither was recorded, or if all quaternions are 0, as in tables that `ravenjax
    trace` may write. Raise UserError if both were recorded, or numbers are no rotation.
    """
    from scipy.spatial.transform import Rotation

    if quat is not None and matrix is not None:
        raise UserError(f"{samples.path}: {arm}_qx.. and {arm}_r11.. mean the same; keep one")
    if matrix is not None:
        turns = matrix.reshape(-1, 3, 3)
        # The product of a rotation matrix and its transpose is the identity. Rounded numbers may
        # differ by 0.02.
        error = np.abs(turns @ np.swapaxes(turns, 1, 2) - np.eye(3)).max(axis=(1, 2))
        bad = np.flatnonzero((error > 0.02) | (np.linalg.det(turns) < 0.0))
        if bad.size:
            raise UserError(
                f"{samples.path}: {samples.place(bad[0])}: {arm}_r11 to {arm}_r33 are no rotation"
                " matrix; expected rows r11 r12 r13 and so on of length 1, perpendicular to each"
                " other, with determinant 1"
            )
        return Rotation.from_matrix(turns).as_quat()
    length = np.zeros(1) if quat is None else np.linalg.norm(quat, axis=1)
    if quat is None or (length == 0.0).all():
        return None
    if (bad := np.flatnonzero(np.abs(length - 1.0) > 1e-2)).size:
        raise UserError(
            f"{samples.path}: {samples.place(bad[0])}: quaternion {arm}_qx.. has length"
            f" {length[bad[0]]:.4g}, expected 1 (x, y, z, w)"
        )
    return quat / length[:, None]


class Bag:
    """An open bag; it finds the topics of each Raven-II arm."""

    def __init__(self, path: Path, reader: "AnyReader", options: ReplayOptions):
        self.path, self._reader, self._options = path, reader, options
        # Type of each topic that has messages.
        self.kinds = {one.topic: one.msgtype for one in reader.connections if one.msgcount}

    def read(self, topic: str, stamped: bool = True) -> TopicMessages:
        """Return the messages of a topic. stamped: with times of header stamps, not log times."""
        return bags.read_topic(self.path, self._reader, topic, stamped)

    def topic(self, arm: str, *ends: str) -> str | None:
        """Return the first topic of an arm whose name ends in one of `ends`, such as setpoint_cp.

        The options may name the topic, another topic of its namespace, or the namespace. Without
        options, any namespace counts that ends in arm1 (gold) or arm2 (green). Raise UserError for
        several namespaces.
        """
        if (option := self._options.topics.get(arm)) is not None:
            if option in self.kinds and option.endswith(ends):
                return option
            space = option.rpartition("/")[0] if option in self.kinds else option.rstrip("/")
            return next((name for end in ends if (name := f"{space}/{end}") in self.kinds), None)
        names = [f"/{ARM_TOPICS[arm]}/{end}" for end in ends]
        topics = [topic for name in names for topic in self.kinds if f"/{topic}".endswith(name)]
        if len({topic.rpartition(ARM_TOPICS[arm])[0] for topic in topics}) > 1:
            raise UserError(
                f"{self.path}: {' and '.join(topics)} belong to several robots; choose a namespace:"
                f" {self._choice(arm, topics)}"
            )
        return topics[0] if topics else None

    def missing(self, arm: str, *ends: str) -> UserError:
        """Return the error for a bag without such topics of an arm. It proposes other topics."""
        space = self._options.topics.get(arm, f"/{ARM_TOPICS[arm]}")
        other_arms = [f"/{name}/" for other, name in ARM_TOPICS.items() if other != arm]
        others = [t for t in self.kinds if t.endswith(ends) and not any(x in t for x in other_arms)]
        kinds = [f"{topic} ({kind})" for topic, kind in sorted(self.kinds.items())]
        advice = f". To use other topics, write {self._choice(arm, others)}" if others else ""
        return UserError(
            f"{self.path}: no topic {' or '.join(f'{space}/{end}' for end in ends)}; the file has"
            f" {list_names(kinds) or 'none'}{advice}"
        )

    def _choice(self, arm: str, topics: Sequence[str]) -> str:
        space = topics[0].rpartition("/")[0]
        return self._options.written(f"topics.{arm}", f'"{space}"')


@contextlib.contextmanager
def open_bag(path: Path, options: ReplayOptions) -> Iterator[Bag]:
    """Open a bag or MCAP file. Raise UserError if the file is damaged."""
    with bags.open_bag(path) as reader:
        yield Bag(path, reader, options)


def _bag_track(path: Path, arms: tuple[ArmName, ...], options: ReplayOptions) -> Track:
    # Reads one topic of poses per arm. Times are header stamps if all arms have them, else log
    # times: all arms have the same clock.
    ends = [f"{source}_cp" for source in SOURCES]
    # By arm: messages of the tip, and times, opening and topic of the jaws.
    tips, jaws, notes = {}, {}, []
    with open_bag(path, options) as bag:
        for arm in arms:
            topic = bag.topic(arm, *ends) or options.topics.get(arm, "")
            if topic not in bag.kinds:
                raise bag.missing(arm, *ends)
            if bag.kinds[topic] != POSE:
                raise UserError(f"{path}: {topic} has type {bag.kinds[topic]}, expected {POSE}")
            tips[arm] = bag.read(topic)
        stamped = all(tip.clock.startswith("header") for tip in tips.values())
        for arm in arms:
            if not stamped:
                tips[arm] = bag.read(tips[arm].topic, stamped=False)
            # Poses without jaws are useful too, so errors of the jaws become notes.
            try:
                jaws[arm] = _jaws(bag, arm, stamped, tips[arm], options.max_gap_s)
            except UserError as error:
                notes.append(f"jaws of {arm} are not read: {error}")
    begin_ns = min(int(tip.time_ns[0]) for tip in tips.values())
    tracks, clocks = {}, []
    used = [tip.topic for tip in tips.values()]
    for arm, tip in tips.items():
        samples = _poses(path, arm, tip, begin_ns)
        frame, frame_notes = _frame(path, arm, tip, options)
        if (jaw := jaws.get(arm)) is not None:
            jaw_ns, opening, topic = jaw
            used.append(topic)
            grasp = np.interp(tip.time_ns - begin_ns, jaw_ns - begin_ns, opening)
            samples.table[f"{arm}_grasp_rad"] = grasp
        tracks[arm] = dataclasses.replace(_arm_track(samples, arm, options), frame=frame)
        clocks.append(samples.clock)
        notes = [*samples.notes, *frame_notes, *notes]
    ignored = tuple(sorted(bag.kinds.keys() - used))
    return Track(path, clocks[0], tracks, None, tuple(used), ignored, tuple(notes))


def _poses(path: Path, arm: str, tip: TopicMessages, begin_ns: int) -> Samples:
    # Converts an arm's pose messages to columns in m and quaternions. Times count from begin_ns.
    import pandas as pd

    names = [f"{arm}_{axis}_m" for axis in "xyz"] + [f"{arm}_{name}" for name in QUAT]
    poses = [
        [*(getattr(one.pose.position, axis) for axis in "xyz")]
        + [*(getattr(one.pose.orientation, axis) for axis in "xyzw")]
        for one in tip.messages
    ]
    table = pd.DataFrame(poses, columns=names, index=tip.number)
    return Samples(path, table, tip.clock, (tip.time_ns - begin_ns) * 1e-9, tip.topic, tip.notes)


def _jaws(
    bag: Bag, arm: ArmName, stamped: bool, tip: TopicMessages, max_gap_s: float
) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Return times (ns), opening (rad) and topic of an arm's jaws; None if they were not recorded.
    The opening comes from CRTK's topic of the jaw, otherwise from the angles of raven2's two jaws.
    stamped: use times of headers, not of arrival. Raise UserError for gaps or a wrong opening.
    """
    jaw_topic = bag.topic(arm, *(f"jaw/{source}_js" for source in SOURCES))
    topic = jaw_topic or bag.topic(arm, *(f"{source}_js" for source in SOURCES))
    if topic is None or bag.kinds[topic] != JOINT_STATE:
        return None
    jaw = bag.read(topic, stamped)
    if jaw_topic:
        positions = [message.position for message in jaw.messages]
        opening = np.array([values[0] if len(values) else np.nan for values in positions])
    else:
        opening = bags.read_joints(bag.path, jaw)[:, JOINTS.index("grasp1") :].sum(axis=1)
        if np.isnan(opening).any():
            return None
    # Only messages between the first and the last message of the tip are checked.
    times = np.clip(jaw.time_ns, *tip.time_ns[[0, -1]])
    steps_s = np.diff(times, prepend=tip.time_ns[0], append=tip.time_ns[-1]) * 1e-9
    widest = np.abs(opening).max()
    if not widest <= WIDEST_RAD or steps_s.min() < 0.0 or steps_s.max() > max_gap_s:
        raise UserError(
            f"{topic}: cannot be read. While the tip was recorded, the time between messages is"
            f" {steps_s.min():.3g} to {steps_s.max():.3g} s, expected 0 to {max_gap_s:g} s"
            f" (operator.max_gap_s). The jaws open by {widest:.4g} rad, expected at most"
            f" {WIDEST_RAD:.3g} rad"
        )
    return jaw.time_ns, opening, topic


def _frame(
    path: Path, arm: ArmName, tip: TopicMessages, options: ReplayOptions
) -> tuple[Frame, list[str]]:
    """Return the frame that the headers of an arm's pose messages name, and notes. An unknown frame
    is permitted if the options place the motion; its axes then count as those of frame 0.
    """
    names = [one.header.frame_id for one in tip.messages]
    for number, name in zip(tip.number, names, strict=True):
        if name != names[0]:
            raise UserError(
                f"{path}: message {number} of {tip.topic} is in frame {name!r}, earlier messages"
                f" are in {names[0]!r}; expected one frame"
            )
    name = names[0].rpartition("/")[2]
    if options.frame is not None or name in ("", frame0_name(arm)):
        return "frame0", []
    if name == f"{ARM_TOPICS[arm]}_base":
        return "arm_base", [f"{tip.topic} is in frame {name}; it is turned into frame 0"]
    rotation, offset = of_arm(options.rotation, arm), of_arm(options.offset_mm, arm)
    if (rotation, offset, options.place) == (None, None, "recorded"):
        raise UserError(
            f"{path}: {tip.topic} is in the unknown frame {names[0]!r}; expected frame 0 of {arm},"
            f" or {ARM_TOPICS[arm]}_base of CRTK. If it is frame 0, write operator.frame ="
            ' "frame0". If only its origin differs, write operator.place = "home", which begins at'
            " the home pose. Otherwise write operator.rotation and operator.offset_mm"
        )
    return "frame0", [f"frame {names[0]} has the axes of frame 0 before operator.rotation"]

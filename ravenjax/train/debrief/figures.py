"""Makes the charts of a debrief, and the data of its replay in three dimensions.

Charts of a session and of each hazard show distances and their limits, depth, force and run level.
A person's learning curves show measures of several sessions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ravenjax import resources
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.train.judge import HazardRow
from ravenjax.train.protocol import TISSUE, Json
from ravenjax.train.recording.reader import Recording
from ravenjax.train.robot import JAW_LENGTH, jaw_rotation, run_levels

_CHARTS = resources.read_tables(__file__, "charts.toml")
MOMENTS: dict[str, tuple[str, str]] = _CHARTS["moments"]
"""Name and colour of each moment of a hazard."""
# Range of a hazard's chart: time before its start, time after its last moment, limits of the end.
BEFORE_MS, AFTER_MS, MIN_END_MS, MAX_END_MS = 400.0, 800.0, 1500.0, 8000.0
MAX_POINTS = 900
"""The largest number of points of a drawn curve."""
HEIGHT, SMALL_HEIGHT = 210, 110  # px

Moment = tuple[str, float, str]  # Kind, time on the chart's axis, text above the line
INTERVAL_MS, HAZARD_INTERVAL_MS = 40, 10
"""Time between two pictures of the replay. The second value applies around a hazard."""
MAX_PICTURES = 20_000
"""The largest number of pictures of a replay. Longer sessions get fewer pictures per second."""
HAZARD_WINDOW_MS = (400, 3000)
"""Times before and after the start of a hazard that `HAZARD_INTERVAL_MS` covers."""
UNITS_PER_M = 10_000  # Units of the replay's positions in a metre


def hazard_charts(
    course: Recording, row: HazardRow, limits: Mapping[str, float], blinded: bool
) -> list[Chart]:
    """Return the charts of one hazard over ms after its activation, at which its fault acts for the
    first time; [] if it was not activated or not recorded. limits: mm by name, drawn as lines
    across the distances. blinded: hide the cue.
    """
    if row.struck_ms is None:
        return []
    # Moments may be a few ms apart, so their lines have no text. The page lists their colours.
    # "strike" is the activation, and time 0 of the charts.
    moments = [("strike", 0.0, "")]
    times = row.times_after_activation.items()
    moments += [(kind, ms, "") for kind, ms in times if kind != "cue" or not blinded]
    end = max(ms for _, ms, _ in moments) + AFTER_MS
    end = min(max(end, MIN_END_MS), MAX_END_MS)
    is_inside = (course.ms >= row.struck_ms - BEFORE_MS) & (course.ms <= row.struck_ms + end)
    if is_inside.sum() < 2:
        return []
    # All arms, if the fault acts on no single arm.
    arms = [row.arm] if row.arm in course.layout.arms else list(course.layout.arms)
    axis = ChartAxis("ms after the start of the hazard", -BEFORE_MS, end, unit="ms")
    section = replace(course, rows=course.rows[is_inside], numbers=course.numbers[is_inside])
    return _charts(section, section.ms - row.struck_ms, axis, arms, moments, limits, blinded)


def session_charts(
    course: Recording, hazards: Sequence[HazardRow], limits: Mapping[str, float], blinded: bool
) -> list[Chart]:
    """Return the charts of the whole session over s, with lines at hazards and responses."""
    time = course.ms / 1000
    moments: list[Moment] = []
    for row in hazards:
        if row.struck_ms is not None:
            moments.append(("strike", row.struck_ms / 1000, str(row.number)))
        if row.response_ms is not None:
            moments.append(("response", row.response_ms / 1000, ""))
    axis = ChartAxis("s into the session", 0.0, float(time[-1]), unit="s")
    arms = course.layout.arms
    progress = _curve("progress", "series7", time, course["progress"])
    return [
        *_charts(course, time, axis, arms, moments, limits, blinded),
        _chart("Task", "share done", axis, [progress], moments, SMALL_HEIGHT, share=True),
    ]


def learning_charts(attempts: Sequence[Json]) -> list[Chart]:
    """Return one chart per measure over a person's sessions; [] for less than two sessions.
    attempts: of `dexterity.read_attempts`. A session without a value has no dot in a chart.
    """
    if len(attempts) < 2:
        return []
    charts = []
    measures = [name for name in attempts[0] if name != "name"]
    for number, measure in enumerate(measures):
        values = np.array([attempt[measure] for attempt in attempts], float)
        known = np.flatnonzero(np.isfinite(values)).tolist()
        if not known:
            continue
        x, y, colour = np.array(known) + 1.0, values[known], palette.series_colour(number)
        # The tooltip of a dot is the session's name.
        tips = tuple(attempts[index]["name"] for index in known)
        dots = Dots(measure, colour, x, y, tips=tips, in_legend=False)
        line = Curve(measure, colour, x, y, in_legend=False)
        low, high = min(0.0, float(y.min())), max(0.0, float(y.max()))
        # The axis needs a length if all values are 0.
        y_axis = ChartAxis(measure, low, high if high > low else low + 1.0)
        x_axis = ChartAxis("session", 0.5, len(attempts) + 0.5)
        charts.append(Chart(measure, x_axis, y_axis, (line, dots), SMALL_HEIGHT))
    return charts


def thin_curve(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of a curve with about `MAX_POINTS` points instead of [T]. The
    greatest value of each interval remains, as do both ends. NaN and infinity become 0.
    """
    finite = np.where(np.isfinite(values), values, 0.0).astype(float)
    stride = int(np.ceil(len(time) / MAX_POINTS))
    starts = range(0, len(time), stride)
    peaks = [start + int(finite[start : start + stride].argmax()) for start in starts]
    indices = np.unique([0, *peaks, len(time) - 1])
    return time[indices], finite[indices]


def _charts(
    course: Recording,
    time: np.ndarray,
    axis: ChartAxis,
    arms: Sequence[str],
    moments: Sequence[Moment],
    limits: Mapping[str, float],
    blinded: bool,
) -> list[Chart]:
    # Returns charts of distances, depth, force and run level over `time`, with lines at moments.
    distances = [
        _curve(time=time, values=course.greatest_of_arms(channel, arms), **style)
        for channel, style in _CHARTS["distances"].items()
    ]
    ends = np.array([axis.low, axis.high])
    lines = [
        Curve(f"{name}, {mm:g} mm", "series7", ends, np.full(2, mm), dashed=True)
        for name, mm in limits.items()
    ]
    charts = [_chart("Distances", "mm", axis, [*distances, *lines], moments, HEIGHT)]
    for channel, (title, unit, colour) in _CHARTS["amounts"].items():
        values = course.greatest_of_arms(channel, arms)
        # Only the force that the operator felt is drawn, and none if the session is blinded.
        if channel == "force":
            values = values * ((course["cue_on"] > 0) & (not blinded))
        if np.nanmax(values) > 0:
            line = _curve(title, colour, time, np.maximum(values, 0.0))
            charts.append(_chart(title, unit, axis, [line], moments, SMALL_HEIGHT))
    # The pedal, 0 or 1, is drawn at the run levels pedal up and pedal down.
    pedal = run_levels.PEDAL_UP + course["pedal"]
    levels = [
        _curve("robot", "series2", time, course["runlevel"], step=True),
        _curve("pedal", "series0", time, pedal, step=True, dashed=True),
    ]
    # A run level has no unit. In its place, the axis explains the numbers: "0 E-stop, 1 init, ..".
    unit = ", ".join(f"{level} {name}" for level, name in enumerate(run_levels.NAMES))
    return [*charts, _chart("Run level and pedal", unit, axis, levels, moments, SMALL_HEIGHT)]


def _curve(
    name: str, colour: str, time: np.ndarray, values: np.ndarray, *, step: bool = False, **style
) -> Curve:
    # Returns a curve with few points. Of a step curve it keeps the corners.
    if not step:
        return Curve(name, colour, *thin_curve(time, values), **style)
    changes = np.flatnonzero(np.diff(values)) + 1
    corners = np.array([0, *changes, len(values) - 1])
    return Curve(name, colour, time[corners], values[corners].astype(float), step=True, **style)


def _chart(
    title: str,
    unit: str,
    axis: ChartAxis,
    curves: Sequence[Curve],
    moments: Sequence[Moment],
    height: int,
    share: bool = False,
) -> Chart:
    # Returns a chart with a vertical line at each moment, of the colour MOMENTS[kind][1]. share:
    # values are 0 to 1. Only a chart of full HEIGHT shows texts, above these lines.
    top = 1.0 if share else 1.1 * max(1e-3, *(float(curve.y.max()) for curve in curves))
    marks: list[Mark] = [
        Curve("", MOMENTS[kind][1], np.full(2, time), np.array([0.0, top]), in_legend=False)
        for kind, time, _ in moments
    ]
    if height == HEIGHT:
        x, texts = np.array([time for _, time, _ in moments]), tuple(text for *_, text in moments)
        # Dots of size 0 show only their texts.
        y, sizes = np.full(len(x), top), (0.0,) * len(x)
        marks.append(Dots("", palette.SAME, x, y, size=sizes, texts=texts, in_legend=False))
    return Chart(title, axis, ChartAxis(unit, 0.0, top, share=share), (*curves, *marks), height)


def player_data(course: Recording, header: Json, hazards: Sequence[HazardRow]) -> Json | None:
    """Return the replay's pictures as JSON: times, pedal, target, tips and marks. None if the
    header lacks the positions of the arms. header: content of session.json.
    """
    bases, arms = header.get("bases") or {}, course.layout.arms
    if any(arm not in bases for arm in arms):
        return None
    last = course.ms[-1]
    interval = max(INTERVAL_MS, int(last) // MAX_PICTURES)
    times = [np.arange(0, last, interval), [last]]
    marks: list[Moment] = []
    for row in hazards:
        if row.struck_ms is not None:
            begin, end = row.struck_ms - HAZARD_WINDOW_MS[0], row.struck_ms + HAZARD_WINDOW_MS[1]
            times.append(np.arange(begin, end, HAZARD_INTERVAL_MS))
            marks.append(("strike", row.struck_ms, row.title or row.hazard))
            if row.response_ms is not None:
                marks.append(("response", row.response_ms, row.response))
    # Times after the last row have no row.
    rows = np.unique(np.searchsorted(course.ms, np.concatenate(times)))
    rows = rows[rows < len(course.ms)]
    blinded = bool(header.get("blinded"))
    return {
        "ms": course.ms[rows].astype(int).tolist(),
        **{name: course[name][rows].astype(int).tolist() for name in ("pedal", "target")},
        "arms": {arm: _arm_positions(course, arm, bases[arm], rows, blinded) for arm in arms},
        "task": header.get("task") or {},
        "tissue": TISSUE,
        "marks": marks,
    }


def _arm_positions(
    course: Recording, arm: str, base: Json, rows: np.ndarray, blinded: bool
) -> Json:
    # Returns positions in the world, in whole units: the remote centre of motion, and in each row
    # the end of the jaws of the robot and its model. The model would show the cue, so it is hidden
    # if the session is blinded. base: origin and quaternion of frame 0.
    # The import takes half a second.
    from scipy.spatial.transform import Rotation

    origin = np.asarray(base["origin"], float)
    rotation = Rotation.from_quat(base["quaternion"]).as_matrix()
    positions = {"remote": np.rint(UNITS_PER_M * origin).astype(int).tolist()}
    channels = {"tip": ("tip", "link_jpos"), "model": ("model_tip", "model_jpos")}
    if blinded:
        del channels["model"]
    for name, (axis, joints) in channels.items():
        # Column 0 of the rotation is the direction of the closed jaws in frame 0.
        jaws = JAW_LENGTH * jaw_rotation(arm, course[f"{arm}/{joints}"][rows])[..., 0]
        points = origin + np.nan_to_num(course[f"{arm}/{axis}"][rows] + jaws) @ rotation.T
        positions[name] = np.rint(UNITS_PER_M * points).astype(int).tolist()
    return positions

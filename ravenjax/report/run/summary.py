"""Describes one run in words: its fault, its verdict, its events in order, and its largest
distances and forces.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax import robots
from ravenjax.bundled import resources
from ravenjax.outcomes import definitions
from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import UNTOLD
from ravenjax.report import wording
from ravenjax.report.wording import format_count, format_number
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import Robot

_TEXTS = resources.read_tables(__file__, "summary.toml")


class RunSummary(NamedTuple):
    """The description of one run in words."""

    title: str
    fault: str
    verdict: str  # verdict, with its meaning
    events: Sequence[RunEvent]
    largest: Sequence[str]  # largest distances, depths and forces, with units

    def lines(self) -> list[str]:
        """Return lines for a terminal. Events of level "debug" are left out."""
        visible = [event for event in self.events if event.level != "debug"]
        course = [f"{format_count(event.tick):>9} ms  {event.text}" for event in visible]
        return [
            self.title,
            f"  fault    {self.fault}",
            f"  verdict  {self.verdict}",
            *(course or ["  nothing happened that did not also happen in the golden run"]),
            *(f"  largest  {peak}" for peak in self.largest),
        ]


def summarize_run(
    row: Mapping[str, Any],
    rules: Rules,
    series: Series | None,
    golden: Mapping[str, Any] | None,
    robot: Robot = robots.USUAL,
) -> RunSummary:
    """Return one row of the result table in words. For `series` and `golden` see `list_events`."""
    return RunSummary(
        f"run {row['run_id']}, row {int(row['index'])}, group {row['group']}",
        wording.describe_fault(row, robot),
        _verdict(row, rules, robot),
        list_events(row, rules, series, golden, robot),
        _peaks(row, rules, series, robot),
    )


def _verdict(row: Mapping[str, Any], rules: Rules, robot: Robot) -> str:
    # Returns the verdict in words: what responded, and what the hazard was.
    if row["failed"]:
        ms = int(row.get("failed_first_ms", -1))
        since = f" at {format_count(ms)} ms" if ms >= 0 else ""
        return f"none: the run has no valid outcome ({row['failed']}{since})"
    cause = row["response_cause"]
    when = f" ({cause} at {format_count(row['response_ms'])} ms)" if cause else ""
    (meaning,) = (
        definition.clause()
        for definition in definitions.definition_rows(rules, robot)
        if (definition.kind, definition.word) == ("response", row["response"])
    )
    parts = [str(row["verdict"]), meaning + when]
    if row["hazard"] == "unintended motion" and row["response"] in UNTOLD:
        parts.append("it evades the checks")
    if row["hazard"] == "loss of motion" and int(row["loss_first_ms"]) < 0:
        more = int(row["halted_ms"]) - int(row["golden_halted_ms"])
        parts.append(
            f"the robot is not live for {format_count(more)} ms longer than in the golden run"
        )
    return "; ".join(parts)


def _peaks(row: Mapping[str, Any], rules: Rules, series: Series | None, robot: Robot) -> list[str]:
    # The largest distances, depth and force of the run, as phrases.
    if series is None:
        far = format_number(float(row["peak_model_deviation_mm"]))
        peaks = [f"true tip {far} mm from the nominal model"]
    else:
        peaks = [line for arm in robot.arms for line in _distances(arm, series)]
    for name, text in _TEXTS["distances"].items():
        if (far := float(row[name])) > rules.limit_mm:
            peaks.append(text.format(format_number(far)))
    if (depth := float(row["tissue_depth_mm"])) > 0.0:
        usual = format_number(float(row["golden_tissue_depth_mm"]))
        peaks.append(
            f"true tip {format_number(depth)} mm deep in the tissue (golden run {usual} mm)"
        )
    force, length = float(row[f"cue{rules.cue}_peak_force"]), int(row[f"cue{rules.cue}_ms"])
    if length > 0:
        peaks.append(
            f"cue of {format_number(force)} device units, for {format_count(length)} ms in total"
        )
    return peaks


def _distances(arm: str, series: Series) -> list[str]:
    # The largest distance of the true tip from the model and from the golden run, and when.
    lines = []
    for other, name in (("model_position", "nominal model"), ("golden_tip", "golden run")):
        if f"{arm}/tip" not in series or f"{arm}/{other}" not in series:
            continue
        distance = 1e3 * np.linalg.norm(series[f"{arm}/tip"] - series[f"{arm}/{other}"], axis=1)
        if np.isfinite(distance).any():
            ms = int(np.nanargmax(distance))
            far = format_number(float(distance[ms]))
            lines.append(f"true {arm} tip {far} mm from the {name}, at {format_count(ms)} ms")
    return lines


MOST_WINDOWS = 3
"""Number of windows of one fault, or pulses of one cue, that are listed individually."""
MOST_CHANGES = 8
"""Number of changes of one state that are listed individually."""
_ORDER = ("fault", "check", "detector", "run level", "brakes", "cue", "hazard", "jump", "operator")
_LEVELS = {"stop": "error", "flag": "warn", "limit": "warn"}

Series = Mapping[str, np.ndarray]


class RunEvent(NamedTuple):
    """One event of a run."""

    tick: int  # ms since the run began
    kind: str  # one of _ORDER
    text: str
    level: str = "info"  # debug (as in the golden run), info, warn or error


def list_events(
    row: Mapping[str, Any],
    rules: Rules,
    series: Series | None,
    golden: Mapping[str, Any] | None = None,
    robot: Robot = robots.USUAL,
) -> list[RunEvent]:
    """Return all events of a run in order.

    `row`: from the result table. `series`: time series of `store.logs.time_series`; without them,
    windows, run levels and durations of cues are left out. `golden`: outcomes of the golden run,
    with check_<name>_count. Checks that trip equally often in the golden run have level "debug".
    """
    series = series or {}
    every = [
        *_faults(robot, row, series),
        *_checks(robot, row, golden or {}),
        *_alarms(row, rules, golden or {}),
        *_cues(row, rules, series),
        *_hazards_and_reaction(row, rules),
        *_states(robot, series),
    ]
    return sorted(every, key=lambda event: (event.tick, _ORDER.index(event.kind)))


def _faults(robot: Robot, row: Mapping[str, Any], series: Series) -> Iterator[RunEvent]:
    # The fault's windows, and when it first and last changed a value.
    for slot in itertools.takewhile(lambda slot: f"fault{slot}_site" in row, itertools.count()):
        words = wording.fault_in_slot(row, slot, robot)
        if not words:
            continue
        where = words.partition(",")[0]
        first, last = (int(row[f"applied{slot}_{end}_ms"]) for end in ("first", "last"))
        windows = active_spans(series.get(f"fault{slot}_active", ()))
        opened = [
            RunEvent(
                start,
                "fault",
                f"{where}: the fault's window opens, for {format_count(end - start)} ms",
            )
            for start, end in windows
        ]
        yield from _first_few(opened, MOST_WINDOWS, f"{where}: {{}} more windows")
        if first >= 0:
            yield RunEvent(first, "fault", f"the fault first changes a value: {words}", "warn")
        if last >= 0:
            ticks = format_count(row[f"applied{slot}_ticks"])
            text = f"the fault last changes a value: {where}, {ticks} ms in total"
            yield RunEvent(last, "fault", text)


def _first_few(events: Sequence[RunEvent], most: int, more: str) -> list[RunEvent]:
    if len(events) <= most:
        return list(events)
    left, last = len(events) - most, format_count(events[-1].tick)
    text = f"{more.format(left)}, the last at {last} ms"
    return [*events[:most], events[most]._replace(text=text)]


def _checks(robot: Robot, row: Mapping[str, Any], golden: Mapping[str, Any]) -> Iterator[RunEvent]:
    # The first trip of each check. One that the golden run has too is no alarm.
    for name in checks.check_names(row):
        first, trips = int(row[f"check_{name}_first_ms"]), int(row[f"check_{name}_count"])
        if first < 0:
            continue
        check = robot.check(name)
        usual = int(golden.get(f"check_{name}_count", 0))
        length = f"{format_count(trips)} ms" if trips > 1 else "once"
        text = f"check {name} trips ({check.meaning}), {length}"
        if trips <= usual:
            yield RunEvent(first, "check", f"{text}, as in the golden run", "debug")
            continue
        beside = f", {format_count(usual)} of them also in the golden run" if usual else ""
        yield RunEvent(first, "check", f"{text}{beside}; it {check.does}", _LEVELS[check.action])


def _alarms(row: Mapping[str, Any], rules: Rules, golden: Mapping[str, Any]) -> Iterator[RunEvent]:
    for number, name in rules.stopping:
        first, alarms = (
            int(row[f"detector{number}_threshold0_{what}"]) for what in ("first_ms", "alarms")
        )
        if first < 0:
            continue
        usual = golden.get(f"detector{number}_threshold0_first_ms")
        too = ", as in the golden run" if usual == first else ""
        often = "" if alarms == 1 else f", for the first of {format_count(alarms)} times"
        text = f"detector {name} raises an alarm{often}{too}; it presses the E-stop"
        yield RunEvent(first, "detector", text, "error")


def _cues(row: Mapping[str, Any], rules: Rules, series: Series) -> Iterator[RunEvent]:
    # The cue's pulses; without time series only the first one is known.
    column = f"cue{rules.cue}_first_ms"
    first, golden = int(row[column]), int(row[f"golden_{column}"])
    name = f"{rules.threshold_mm:g} mm cue"
    too = f"; the golden run had one at {format_count(golden)} ms" if 0 <= golden <= first else ""
    level = "debug" if too else "warn"
    forces = {name: values for name, values in series.items() if name.endswith("/cue_force")}
    if not forces and first >= 0:
        text = f"{name} on: the reported tip is that far from the nominal model{too}"
        yield RunEvent(first, "cue", text, level)
    for full, values in forces.items():
        arm, force = full.partition("/")[0], np.asarray(values)[:, rules.cue]
        distance = series.get(f"{arm}/tip_error_mm", np.full(len(force), np.nan))
        pulses = []
        for start, end in active_spans(force > 0.0):
            far = format_number(float(distance[start]))
            peak = format_number(float(force[start:end].max()))
            text = (
                f"{name} on for {format_count(end - start)} ms, at most {peak} device"
                f" units: the reported {arm} tip is {far} mm from the nominal model{too}"
            )
            pulses.append(RunEvent(start, "cue", text, level))
        yield from _first_few(pulses, MOST_WINDOWS, f"{name}: {{}} more pulses")


def _hazards_and_reaction(row: Mapping[str, Any], rules: Rules) -> Iterator[RunEvent]:
    limit = f"more than {rules.limit_mm:g} mm from"
    for name, text in _TEXTS["hazards"].items():
        if (ms := int(row[f"{name}_first_ms"])) >= 0:
            far = format_number(float(row[f"{name}_mm"]))
            yield RunEvent(ms, "hazard", f"{text.format(limit=limit)} (up to {far} mm)", "error")
    if (ms := int(row.get("reaction_ms", -1))) >= 0:
        yield RunEvent(ms, "operator", "the operator begins to react to the cue")
    if (ms := int(row[f"{rules.jump}_first_ms"])) >= 0:
        yield RunEvent(ms, "jump", _TEXTS["jumps"].get(rules.jump, f"the tip jumps ({rules.jump})"))


def _states(robot: Robot, series: Series) -> Iterator[RunEvent]:
    # Changes of run level, software E-stop and brakes.
    level = robot.run_level
    texts = {
        "runlevel": ("run level", lambda old, new: f"run level: {level(old)} to {level(new)}", 0),
        "soft_estopped": (
            "run level",
            lambda _, new: ("software E-stop released", "software E-stop raised: DACs are 0")[new],
            1,
        ),
        "brakes": ("brakes", lambda _, new: f"the PLC {('opens', 'closes')[new]} the brakes", None),
    }
    for name, (kind, text, alarming) in texts.items():
        values = np.asarray(series.get(name, ())).astype(int)
        values = values if name == "runlevel" else values.astype(bool).astype(int)
        changes = []
        for ms in (np.flatnonzero(np.diff(values)) + 1).tolist():
            old, new = int(values[ms - 1]), int(values[ms])
            changes.append(
                RunEvent(ms, kind, text(old, new), "error" if new == alarming else "info")
            )
        yield from _first_few(changes, MOST_CHANGES, "{} more changes")


def active_spans(active: ArrayLike) -> list[tuple[int, int]]:
    """Return where each stretch of true values begins and ends."""
    edges = np.diff(np.concatenate([[0], np.asarray(active, bool), [0]]).astype(np.int8))
    return [
        (int(first), int(end))
        for first, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
    ]

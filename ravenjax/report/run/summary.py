"""Describes one run in words: its fault, its verdict, its events in order, and its largest
distances and forces.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax import robots
from ravenjax.outcomes import definitions
from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import UNTOLD
from ravenjax.report import wording
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import Robot


class RunSummary(NamedTuple):
    """The description of one run in words."""

    title: str
    fault: str
    verdict: str  # verdict, with its meaning
    events: Sequence[RunEvent]
    peaks: Sequence[str]  # largest distances, depths and forces, with units

    def lines(self) -> list[str]:
        """Return lines for a terminal. Events of level "debug" are left out."""
        visible = [event for event in self.events if event.level != "debug"]
        course = [f"{wording.format_count(event.ms):>9} ms  {event.text}" for event in visible]
        return [
            self.title,
            f"  fault    {self.fault}",
            f"  verdict  {self.verdict}",
            *(course or ["  nothing happened that did not also happen in the golden run"]),
            *(f"  largest  {peak}" for peak in self.peaks),
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "title": self.title,
            "fault": self.fault,
            "verdict": self.verdict,
            "events": [event.as_dict() for event in self.events],
            "largest": list(self.peaks),
        }


def summarize_run(
    row: Mapping[str, Any],
    rules: Rules,
    series: Series | None = None,
    golden: Mapping[str, Any] | None = None,
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
    if row["failed"]:
        since = (
            f" at {wording.format_count(ms)} ms"
            if (ms := int(row.get("failed_first_ms", -1))) >= 0
            else ""
        )
        return f"none: the run has no valid outcome ({row['failed']}{since})"
    parts = [str(row["verdict"])]
    cause = (
        f" ({row['response_cause']} at {wording.format_count(row['response_ms'])} ms)"
        if row["response_cause"]
        else ""
    )
    responses = {
        one.word: one.clause()
        for one in definitions.definition_rows(rules, robot)
        if one.kind == "response"
    }
    parts.append(responses[str(row["response"])] + cause)
    if row["hazard"] == "unintended motion" and row["response"] in UNTOLD:
        parts.append("it evades the checks")
    if row["hazard"] == "loss of motion" and int(row["loss_first_ms"]) < 0:
        more = int(row["halted_ms"]) - int(row["golden_halted_ms"])
        parts.append(
            f"the robot is not live for {wording.format_count(more)} ms longer than in the golden"
            " run"
        )
    return "; ".join(parts)


def _peaks(row: Mapping[str, Any], rules: Rules, series: Series | None, robot: Robot) -> list[str]:
    peaks = (
        [] if series is None else [line for arm in robot.arms for line in _distances(arm, series)]
    )
    if series is None:
        far = wording.format_number(float(row["peak_model_deviation_mm"]))
        peaks.append(f"true tip {far} mm from the nominal model")
    for name, text in _DISTANCES.items():
        if (far := float(row[name])) > rules.limit_mm:
            peaks.append(text.format(wording.format_number(far)))
    if (depth := float(row["tissue_depth_mm"])) > 0.0:
        usual = wording.format_number(float(row["golden_tissue_depth_mm"]))
        peaks.append(
            f"true tip {wording.format_number(depth)} mm deep in the tissue (golden run {usual} mm)"
        )
    force, length = float(row[f"cue{rules.cue}_peak_force"]), int(row[f"cue{rules.cue}_ms"])
    if length > 0:
        peaks.append(
            f"cue of {wording.format_number(force)} device units, for"
            f" {wording.format_count(length)} ms in total"
        )
    return peaks


_DISTANCES = {
    "unintended_off_mm": (
        "true tip {} mm from the golden run and from standing still while the robot was not live"
    ),
    "false_report_mm": "reported tip {} mm from the true tip, more than in the golden run",
}
"""Descriptions of distances, printed if beyond the limit. The sizes of other hazards are printed
with their beginning.
"""


def _distances(arm: str, series: Series) -> list[str]:
    """Describe how far the arm's true tip was from the nominal model and from the golden run, and
    when.
    """
    lines = []
    for other, name in (("model_position", "nominal model"), ("golden_tip", "golden run")):
        if f"{arm}/tip" in series and f"{arm}/{other}" in series:
            distance = 1e3 * np.linalg.norm(
                np.asarray(series[f"{arm}/tip"]) - series[f"{arm}/{other}"], axis=1
            )
            if np.isfinite(distance).any():
                ms = int(np.nanargmax(distance))
                far = wording.format_number(float(distance[ms]))
                lines.append(
                    f"true {arm} tip {far} mm from the {name}, at {wording.format_count(ms)} ms"
                )
    return lines


MOST_WINDOWS = 3
"""Number of windows of one fault, or pulses of one cue, that are listed individually."""
MOST_CHANGES = 8
"""Number of changes of one state that are listed individually."""
_ORDER = ("fault", "check", "detector", "run level", "brakes", "cue", "hazard", "jump", "operator")
_LEVELS = {"stop": "error", "flag": "warn", "limit": "warn"}

_JUMPS = {
    "jump_code": "the reported tip jumps (rule of the published code)",
    "jump_text": "the true tip jumps (rule of the published text)",
    "jump_tip": "the true tip jumps (rule of the published code)",
}

Series = Mapping[str, np.ndarray]


class RunEvent(NamedTuple):
    """One event of a run."""

    ms: int  # since the run began
    kind: str  # one of _ORDER
    text: str
    level: str = "info"  # debug (as in the golden run), info, warn or error

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for the log of a trace."""
        return {"tick": self.ms, "kind": self.kind, "level": self.level, "text": self.text}


def list_events(
    row: Mapping[str, Any],
    rules: Rules,
    series: Series | None = None,
    golden: Mapping[str, Any] | None = None,
    robot: Robot = robots.USUAL,
) -> list[RunEvent]:
    """Return all events of a run in order.

    `row`: from the result table. `series`: as from `store.logs.time_series`; without it, windows,
    run levels and durations of cues are left out. `golden`: outcomes of the golden run, with
    check_<name>_count. Checks that trip equally often in the golden run have level "debug".
    """
    parts = [
        _faults(robot, row, series),
        _checks(robot, row, golden),
        _alarms(row, rules, golden),
        _cues(row, rules, series),
        _hazards(row, rules),
        _others(row, rules),
    ]
    if series is not None:
        parts.append(_states(robot, series))
    every = [event for part in parts for event in part]
    return sorted(every, key=lambda event: (event.ms, _ORDER.index(event.kind)))


def _faults(robot: Robot, row: Mapping[str, Any], series: Series | None) -> Iterator[RunEvent]:
    for slot in range(sum(f"fault{slot}_site" in row for slot in range(len(row)))):
        words = wording.fault_in_slot(row, slot, robot)
        if not words:
            continue
        where = words.partition(",")[0]
        first, last = (int(row[f"applied{slot}_{end}_ms"]) for end in ("first", "last"))
        windows = _spans((series or {}).get(f"fault{slot}_active", ()))
        opened = [
            RunEvent(
                start,
                "fault",
                f"{where}: the fault's window opens, for {wording.format_count(end - start)} ms",
            )
            for start, end in windows
        ]
        yield from _first_few(opened, MOST_WINDOWS, f"{where}: {{}} more windows")
        if first >= 0:
            yield RunEvent(first, "fault", f"the fault first changes a value: {words}", "warn")
        if last >= 0:
            ticks = wording.format_count(row[f"applied{slot}_ticks"])
            text = f"the fault last changes a value: {where}, {ticks} ms in total"
            yield RunEvent(last, "fault", text)


def _first_few(events: Sequence[RunEvent], most: int, more: str) -> list[RunEvent]:
    """Return at most `most` events, and one event that summarises the others. `more`: its text, in
    which {} is their number.
    """
    if len(events) <= most:
        return list(events)
    left, last = len(events) - most, wording.format_count(events[-1].ms)
    text = f"{more.format(left)}, the last at {last} ms"
    return [*events[:most], events[most]._replace(text=text)]


def _checks(
    robot: Robot, row: Mapping[str, Any], golden: Mapping[str, Any] | None
) -> Iterator[RunEvent]:
    for name in checks.check_names(row):
        first, trips = int(row[f"check_{name}_first_ms"]), int(row[f"check_{name}_count"])
        if first < 0:
            continue
        check = robot.check(name)
        usual = int(golden[f"check_{name}_count"]) if golden is not None else 0
        length = f"{wording.format_count(trips)} ms" if trips > 1 else "once"
        text = f"check {name} trips ({check.meaning}), {length}"
        if trips <= usual:
            yield RunEvent(first, "check", f"{text}, as in the golden run", "debug")
            continue
        beside = f", {wording.format_count(usual)} of them also in the golden run" if usual else ""
        yield RunEvent(first, "check", f"{text}{beside}; it {check.does}", _LEVELS[check.action])


def _alarms(
    row: Mapping[str, Any], rules: Rules, golden: Mapping[str, Any] | None
) -> Iterator[RunEvent]:
    """Return the alarms of detectors that press the E-stop."""
    for number, name in rules.stopping:
        first, alarms = (
            int(row[f"detector{number}_threshold0_{what}"]) for what in ("first_ms", "alarms")
        )
        if first < 0:
            continue
        usual = (
            -1 if golden is None else int(golden.get(f"detector{number}_threshold0_first_ms", -1))
        )
        too = ", as in the golden run" if usual == first else ""
        often = "" if alarms == 1 else f", for the first of {wording.format_count(alarms)} times"
        text = f"detector {name} raises an alarm{often}{too}; it presses the E-stop"
        yield RunEvent(first, "detector", text, "error")


def _cues(row: Mapping[str, Any], rules: Rules, series: Series | None) -> Iterator[RunEvent]:
    first, golden = (
        int(row[f"cue{rules.cue}_first_ms"]),
        int(row[f"golden_cue{rules.cue}_first_ms"]),
    )
    name = f"{rules.threshold_mm:g} mm cue"
    too = (
        f"; the golden run had one at {wording.format_count(golden)} ms"
        if 0 <= golden <= first
        else ""
    )
    level = "debug" if too else "warn"
    forces = {} if series is None else {n: v for n, v in series.items() if n.endswith("/cue_force")}
    if not forces:
        if first >= 0:
            yield RunEvent(
                first,
                "cue",
                f"{name} on: the reported tip is that far from the nominal model{too}",
                level,
            )
        return
    for full, values in forces.items():
        arm, force = full.partition("/")[0], np.asarray(values)[:, rules.cue]
        unknown = np.full(len(force), np.nan)
        distance = np.asarray((series or {}).get(f"{arm}/tip_error_mm", unknown))
        pulses = []
        for start, end in _spans(force > 0.0):
            far = wording.format_number(float(distance[start]))
            peak = wording.format_number(float(force[start:end].max()))
            text = (
                f"{name} on for {wording.format_count(end - start)} ms, at most {peak} device"
                f" units: the reported {arm} tip is {far} mm from the nominal model{too}"
            )
            pulses.append(RunEvent(start, "cue", text, level))
        yield from _first_few(pulses, MOST_WINDOWS, f"{name}: {{}} more pulses")


def _hazards(row: Mapping[str, Any], rules: Rules) -> Iterator[RunEvent]:
    limit = f"more than {rules.limit_mm:g} mm from"
    texts = {
        "unintended": (
            f"unintended motion: the true tip is {limit} the golden run, the nominal model and"
            " where standing still would have left it"
        ),
        "loss": (
            f"loss of motion: the true tip is {limit} the golden run and the nominal model, and"
            " does not follow"
        ),
        "false_report": f"false report: the reported tip is {limit} the true one",
    }
    for name, text in texts.items():
        if (ms := int(row[f"{name}_first_ms"])) >= 0:
            yield RunEvent(
                ms,
                "hazard",
                f"{text} (up to {wording.format_number(float(row[f'{name}_mm']))} mm)",
                "error",
            )


def _others(row: Mapping[str, Any], rules: Rules) -> Iterator[RunEvent]:
    if (ms := int(row.get("reaction_ms", -1))) >= 0:
        yield RunEvent(ms, "operator", "the operator begins to react to the cue")
    if (ms := int(row[f"{rules.jump}_first_ms"])) >= 0:
        yield RunEvent(ms, "jump", _JUMPS.get(rules.jump, f"the tip jumps ({rules.jump})"))


def _states(robot: Robot, series: Series) -> Iterator[RunEvent]:
    """Return the changes of run level, software E-stop and brakes."""
    names = {number: robot.run_level(number) for number in range(len(robot.run_levels))}
    texts = {
        "runlevel": ("run level", lambda old, new: f"run level: {names[old]} to {names[new]}", 0),
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


def _spans(active: ArrayLike) -> list[tuple[int, int]]:
    """Return (first, end) of each stretch in which `active` is True."""
    edges = np.diff(np.concatenate([[0], np.asarray(active, bool), [0]]).astype(np.int8))
    return [
        (int(first), int(end))
        for first, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
    ]

"""What happened in one run, event by event, in words with units: from its row of the result table,
and from its time series where they are at hand.

Events are in the order of time; those of one millisecond in the order of the loop: fault, checks,
detectors that stop, run level, brakes, cue, hazard, operator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax import robots
from ravenjax.outcomes.events import Rules
from ravenjax.report import wording
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import Robot

MOST_WINDOWS = 3
"""Windows of one fault, and pulses of one cue, that are told one by one."""
MOST_CHANGES = 8
"""Changes of one state that are told one by one."""
_ORDER = ("fault", "check", "detector", "run level", "brakes", "cue", "hazard", "jump", "operator")
_LEVELS = {"stop": "error", "flag": "warn", "limit": "warn"}

_JUMPS = {
    "jump_code": "the reported tip jumps (rule of the published code)",
    "jump_text": "the true tip jumps (rule of the published text)",
    "jump_tip": "the true tip jumps (rule of the published code)",
}

Series = Mapping[str, np.ndarray]


class RunEvent(NamedTuple):
    """One thing that happened."""

    ms: int  # since the run began
    kind: str  # of _ORDER
    text: str
    level: str = "info"  # debug (as in the golden run), info, warn or error

    def as_dict(self) -> dict[str, Any]:
        """As the log of a trace takes it."""
        return {"tick": self.ms, "kind": self.kind, "level": self.level, "text": self.text}


def events(
    row: Mapping[str, Any],
    rules: Rules,
    series: Series | None = None,
    golden: Mapping[str, Any] | None = None,
    robot: Robot = robots.USUAL,
) -> list[RunEvent]:
    """Everything that happened in a run.

    row: of the result table. series: as `store.logs.time_series`; without them windows, run levels
    and the end of cues are left out. golden: outcomes of the golden run, with check_<name>_count;
    checks that trip as often in it are of level "debug".
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
    slot = 0
    while f"fault{slot}_site" in row:
        if words := wording.fault_in_slot(row, slot, robot):
            active = (
                series[f"fault{slot}_active"]
                if series is not None and f"fault{slot}_active" in series
                else None
            )
            windows = [] if active is None else _spans(np.asarray(active, bool))
            ticks = 0 if active is None else len(active)
            first, last = int(row[f"applied{slot}_first_ms"]), int(row[f"applied{slot}_last_ms"])
            where = words.partition(",")[0]
            yield from _fault(words, windows, first)
            if last >= 0:
                length = f"{wording.count(row[f'applied{slot}_ticks'])} ms in all"
                ends = _ending(windows, last, ticks)
                yield RunEvent(
                    last, "fault", f"the fault last changes a value{ends}: {where}, {length}"
                )
            if windows and last + 1 != windows[-1][1] < ticks:
                yield RunEvent(
                    windows[-1][1],
                    "fault",
                    f"{where}: the {'last ' * (len(windows) > 1)}window closes",
                )
        slot += 1


def _fault(words: str, windows: list[tuple[int, int]], first: int) -> Iterator[RunEvent]:
    """Windows of one fault, and when it first changed a value (-1: never)."""
    where = words.partition(",")[0]
    opened = windows[0][0] if windows else -1
    if opened >= 0 and opened != first:
        yield RunEvent(opened, "fault", f"the fault's window opens: {words}")
    if first >= 0:
        later = (
            f", {wording.count(first - opened)} ms after its window opened"
            if 0 <= opened < first
            else ""
        )
        yield RunEvent(
            first,
            "fault",
            f"the fault first changes a value: {where if later else words}{later}",
            "warn",
        )
    for start, end in windows[1:MOST_WINDOWS]:
        yield RunEvent(
            start, "fault", f"{where}: window opens again, for {wording.count(end - start)} ms"
        )
    if len(windows) > MOST_WINDOWS:
        final, left = wording.count(windows[-1][0]), len(windows) - MOST_WINDOWS
        yield RunEvent(
            windows[MOST_WINDOWS][0],
            "fault",
            f"{where}: {left} more windows, the last opens at {final} ms",
        )


def _ending(windows: list[tuple[int, int]], last: int, ticks: int) -> str:
    """What ends with the last change of a value."""
    if not windows or last + 1 != windows[-1][1]:
        return ""
    if last + 1 == ticks:
        return " as the run ends"
    return ", its last window closes" if len(windows) > 1 else ", its window closes"


def _checks(
    robot: Robot, row: Mapping[str, Any], golden: Mapping[str, Any] | None
) -> Iterator[RunEvent]:
    for name in checks.names(row):
        first, trips = int(row[f"check_{name}_first_ms"]), int(row[f"check_{name}_count"])
        if first < 0:
            continue
        check = robot.check(name)
        usual = int(golden[f"check_{name}_count"]) if golden is not None else 0
        length = f"{wording.count(trips)} ms" if trips > 1 else "once"
        text = f"check {name} trips ({check.meaning}), {length}"
        if trips <= usual:
            yield RunEvent(first, "check", f"{text}, as in the golden run", "debug")
            continue
        beside = f", {wording.count(usual)} of them in the golden run, too" if usual else ""
        yield RunEvent(first, "check", f"{text}{beside}; it {check.does}", _LEVELS[check.action])


def _alarms(
    row: Mapping[str, Any], rules: Rules, golden: Mapping[str, Any] | None
) -> Iterator[RunEvent]:
    """Of detectors that press the E-stop."""
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
        often = "" if alarms == 1 else f", for the first of {wording.count(alarms)} times"
        text = f"detector {name} alarms{often}{too}; it presses the E-stop"
        yield RunEvent(first, "detector", text, "error")


def _cues(row: Mapping[str, Any], rules: Rules, series: Series | None) -> Iterator[RunEvent]:
    first, golden = (
        int(row[f"cue{rules.cue}_first_ms"]),
        int(row[f"golden_cue{rules.cue}_first_ms"]),
    )
    name = f"{rules.threshold_mm:g} mm cue"
    too = f"; the golden run had one at {wording.count(golden)} ms" if 0 <= golden <= first else ""
    level = "debug" if too else "warn"
    forces = {} if series is None else {n: v for n, v in series.items() if n.endswith("/cue_force")}
    if not forces:
        if first >= 0:
            yield RunEvent(
                first,
                "cue",
                f"{name} on: the reported tip is that far off the nominal model{too}",
                level,
            )
        return
    for full, values in forces.items():
        arm, force = full.partition("/")[0], np.asarray(values)[:, rules.cue]
        distance = np.asarray(
            (series or {}).get(f"{arm}/tip_error_mm", np.full(len(force), np.nan))
        )
        spans = _spans(force > 0.0)
        for start, end in spans[:MOST_WINDOWS]:
            far = (
                f"the reported {arm} tip is {wording.number(float(distance[start]))} mm off the"
                " nominal model"
            )
            yield RunEvent(start, "cue", f"{name} on: {far}{too}", level)
            if end < len(force):
                peak = wording.number(float(force[start:end].max()))
                length = wording.count(end - start)
                yield RunEvent(
                    end, "cue", f"{name} off after {length} ms, {peak} device units at most"
                )
        if len(spans) > MOST_WINDOWS:
            left, last = len(spans) - MOST_WINDOWS, wording.count(spans[-1][0])
            yield RunEvent(
                spans[MOST_WINDOWS][0],
                "cue",
                f"{name}: {left} more pulses, the last at {last} ms",
                level,
            )


def _hazards(row: Mapping[str, Any], rules: Rules) -> Iterator[RunEvent]:
    limit = f"more than {rules.limit_mm:g} mm from"
    texts = {
        "unintended": (
            f"unintended motion: the true tip is {limit} golden run, nominal model and standing"
            " still"
        ),
        "loss": (
            f"loss of motion: the true tip is {limit} golden run and nominal model and does not"
            " follow"
        ),
        "false_report": f"false report: the reported tip is {limit} the true one",
    }
    for name, text in texts.items():
        if (ms := int(row[f"{name}_first_ms"])) >= 0:
            yield RunEvent(
                ms,
                "hazard",
                f"{text} (up to {wording.number(float(row[f'{name}_mm']))} mm)",
                "error",
            )


def _others(row: Mapping[str, Any], rules: Rules) -> Iterator[RunEvent]:
    if (ms := int(row.get("reaction_ms", -1))) >= 0:
        yield RunEvent(ms, "operator", "the operator begins to react to the cue")
    if (ms := int(row[f"{rules.jump}_first_ms"])) >= 0:
        yield RunEvent(ms, "jump", _JUMPS.get(rules.jump, f"the tip jumps ({rules.jump})"))


def _states(robot: Robot, series: Series) -> Iterator[RunEvent]:
    """Changes of run level, software E-stop and brakes."""
    if "runlevel" in series:
        levels = np.asarray(series["runlevel"]).astype(int)
        names = {number: robot.run_level(number) for number in np.unique(levels).tolist()}
        yield from _changes(
            "run level",
            levels,
            lambda old, new: f"run level: {names[old]} to {names[new]}",
            alarming=0,
        )
    if "soft_estopped" in series:
        stop = (np.asarray(series["soft_estopped"]) != 0).astype(int)
        texts = ("software E-stop released", "software E-stop raised: DACs are 0")
        yield from _changes("run level", stop, lambda _, new: texts[new], alarming=1)
    if "brakes" in series:
        closed = (np.asarray(series["brakes"]) != 0).astype(int)
        yield from _changes(
            "brakes", closed, lambda _, new: f"the PLC {('opens', 'closes')[new]} the brakes"
        )


def _changes(
    kind: str, values: np.ndarray, text: Callable[[int, int], str], alarming: int | None = None
) -> Iterator[RunEvent]:
    """An event at each change of a whole number; those to the value `alarming` are errors."""
    times = (np.flatnonzero(values[1:] != values[:-1]) + 1).tolist()
    for ms in times[:MOST_CHANGES]:
        new = int(values[ms])
        yield RunEvent(
            ms, kind, text(int(values[ms - 1]), new), "error" if new == alarming else "info"
        )
    if len(times) > MOST_CHANGES:
        left, last = len(times) - MOST_CHANGES, wording.count(times[-1])
        yield RunEvent(times[MOST_CHANGES], kind, f"{left} more changes, the last at {last} ms")


def _spans(active: np.ndarray) -> list[tuple[int, int]]:
    """(first, end) of each stretch that is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(np.int8)))
    return [(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2], strict=True)]

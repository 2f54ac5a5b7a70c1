"""Describes one run in words: fault, verdict, events in order, largest distances and forces."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax import robots
from ravenjax.outcomes import definitions
from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import UNTOLD
from ravenjax.report import wording
from ravenjax.store.motion.resampling import true_stretches
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import Robot

MAX_WINDOWS = 3
"""Number of windows of one fault, or pulses of one cue, that are listed individually."""
MAX_CHANGES = 8
"""Number of changes of one state that are listed individually."""
_ORDER = ("fault", "check", "detector", "run level", "brakes", "cue", "hazard", "jump", "operator")

Series = Mapping[str, np.ndarray]


class RunEvent(NamedTuple):
    """One event of a run."""

    tick: int  # ms since the run began
    kind: str  # one of _ORDER
    text: str
    level: str  # debug (as in the golden run), info, warn or error


class RunSummary(NamedTuple):
    """The description of one run in words."""

    title: str
    fault: str
    verdict: str  # verdict, with its meaning
    events: Sequence[RunEvent]
    largest: Sequence[str]  # largest distances, depths and forces, with units

    def lines(self) -> list[str]:
        """Return lines for a terminal. Events of level "debug" are left out."""
        return wording.fill_template("run_lines.txt.j2", run=self)


def summarize_run(
    row: Mapping[str, Any],
    rules: Rules,
    series: Series | None,
    golden: Mapping[str, Any] | None,
    robot: Robot = robots.USUAL,
) -> RunSummary:
    """Return one row of the result table in words. For `series` and `golden` see `list_events`."""
    rows = definitions.definition_rows(rules, robot)
    defined = {(definition.kind, definition.word): definition for definition in rows}
    verdict, *largest = wording.fill_template(
        "run_summary.txt.j2",
        row=row,
        rules=rules,
        untold=UNTOLD,
        definition=defined.get(("response", row["response"])),
        distances=None if series is None else list(_largest_distances(robot, series)),
    )
    return RunSummary(
        f"run {row['run_id']}, row {int(row['index'])}, group {row['group']}",
        wording.describe_fault(row, robot),
        verdict,
        list_events(row, rules, series, golden, robot),
        largest,
    )


def _largest_distances(robot: Robot, series: Series):
    # Yields for each arm and reference the largest distance of the true tip from the reference in
    # mm, and its tick: (arm, name of the reference, distance, tick).
    for arm in robot.arms:
        for reference, name in (("model_position", "nominal model"), ("golden_tip", "golden run")):
            tip, expected = series.get(f"{arm}/tip"), series.get(f"{arm}/{reference}")
            if tip is None or expected is None:
                continue
            distance = 1e3 * np.linalg.norm(tip - expected, axis=1)
            if np.isfinite(distance).any():
                ms = int(np.nanargmax(distance))
                yield arm, name, float(distance[ms]), ms


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
    states = ("runlevel", "soft_estopped", "brakes")
    lines = wording.fill_template(
        "run_events.txt.j2",
        row=row,
        rules=rules,
        series=series,
        golden=golden or {},
        robot=robot,
        faults=wording.fault_phrases(row, robot),
        checks=checks.check_names(row),
        spans=true_stretches,
        pulses=list(_list_pulses(series, rules.cue)) or None,
        changes={name: _list_changes(series, name) for name in states},
        most_windows=MAX_WINDOWS,
        most_changes=MAX_CHANGES,
    )
    parts = (line.split("|", 3) for line in lines if line)
    events = [RunEvent(int(tick), kind, text, level) for tick, kind, level, text in parts]
    return sorted(events, key=lambda event: (event.tick, _ORDER.index(event.kind)))


def _list_pulses(series: Series, cue: int):
    # Yields for each arm a list of its pulses: (first ms, ms after the last, arm, distance from the
    # nominal model at the start in mm, largest force in device units). cue: number of the set.
    for name in series:
        arm, _, signal = name.partition("/")
        if signal != "cue_force":
            continue
        force = np.asarray(series[name])[:, cue]
        distance = series.get(f"{arm}/tip_error_mm", np.full(len(force), np.nan))
        yield [
            (start, end, arm, float(distance[start]), float(force[start:end].max()))
            for start, end in true_stretches(force > 0.0)
        ]


def _list_changes(series: Series, name: str):
    # Returns (tick, old value, new value) for each change of a state.
    values = np.asarray(series.get(name, ())).astype(int if name == "runlevel" else bool)
    ticks = np.flatnonzero(np.diff(values)) + 1
    return [(int(ms), int(values[ms - 1]), int(values[ms])) for ms in ticks]

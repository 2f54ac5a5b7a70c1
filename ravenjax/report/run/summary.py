"""One run in words: which fault, what happened when, how far the tip went. Lines for a terminal,
parts for a page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax import robots
from ravenjax.outcomes import definitions
from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import UNTOLD
from ravenjax.report import wording
from ravenjax.report.run.events import RunEvent, Series, events
from ravenjax.vocabulary.robot import Robot


class RunSummary(NamedTuple):
    """One run."""

    title: str
    fault: str
    verdict: str  # with what it means
    events: Sequence[RunEvent]
    peaks: Sequence[str]  # largest distances, depths and forces, with units

    def lines(self) -> list[str]:
        """As a terminal shows it; events of level "debug" are left out."""
        visible = [event for event in self.events if event.level != "debug"]
        course = [f"{wording.count(event.ms):>9} ms  {event.text}" for event in visible]
        return [
            self.title,
            f"  fault    {self.fault}",
            f"  verdict  {self.verdict}",
            *(course or ["  nothing happened that did not happen in the golden run"]),
            *(f"  largest  {peak}" for peak in self.peaks),
        ]

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "title": self.title,
            "fault": self.fault,
            "verdict": self.verdict,
            "events": [event.as_dict() for event in self.events],
            "largest": list(self.peaks),
        }


def summary(
    row: Mapping[str, Any],
    rules: Rules,
    series: Series | None = None,
    golden: Mapping[str, Any] | None = None,
    robot: Robot = robots.USUAL,
) -> RunSummary:
    """One row of the result table in words; series and golden as for `run_events.events`."""
    return RunSummary(
        f"run {row['run_id']}, row {int(row['index'])}, group {row['group']}",
        wording.fault(row, robot),
        _verdict(row, rules, robot),
        events(row, rules, series, golden, robot),
        _peaks(row, rules, series, robot),
    )


def _verdict(row: Mapping[str, Any], rules: Rules, robot: Robot) -> str:
    if row["failed"]:
        since = (
            f" at {wording.count(ms)} ms"
            if (ms := int(row.get("failed_first_ms", -1))) >= 0
            else ""
        )
        return f"none: the run has no valid outcome ({row['failed']}{since})"
    parts = [str(row["verdict"])]
    cause = (
        f" ({row['response_cause']} at {wording.count(row['response_ms'])} ms)"
        if row["response_cause"]
        else ""
    )
    responses = {
        one.word: one.clause() for one in definitions.rows(rules, robot) if one.kind == "response"
    }
    parts.append(responses[str(row["response"])] + cause)
    if row["hazard"] == "unintended motion" and row["response"] in UNTOLD:
        parts.append("it evades the checks")
    if row["hazard"] == "loss of motion" and int(row["loss_first_ms"]) < 0:
        more = int(row["halted_ms"]) - int(row["golden_halted_ms"])
        parts.append(
            f"the robot is not live for {wording.count(more)} ms longer than in the golden run"
        )
    return "; ".join(parts)


def _peaks(row: Mapping[str, Any], rules: Rules, series: Series | None, robot: Robot) -> list[str]:
    peaks = (
        [] if series is None else [line for arm in robot.arms for line in _distances(arm, series)]
    )
    if series is None:
        far = wording.number(float(row["peak_model_deviation_mm"]))
        peaks.append(f"true tip {far} mm off the nominal model")
    for name, text in _DISTANCES.items():
        if (far := float(row[name])) > rules.limit_mm:
            peaks.append(text.format(wording.number(far)))
    if (depth := float(row["tissue_depth_mm"])) > 0.0:
        usual = wording.number(float(row["golden_tissue_depth_mm"]))
        peaks.append(
            f"true tip {wording.number(depth)} mm deep in the tissue (golden run {usual} mm)"
        )
    force, length = float(row[f"cue{rules.cue}_peak_force"]), int(row[f"cue{rules.cue}_ms"])
    if length > 0:
        peaks.append(
            f"cue of {wording.number(force)} device units, on for {wording.count(length)} ms in all"
        )
    return peaks


_DISTANCES = {
    "unintended_off_mm": (
        "true tip {} mm off golden run and standing still while the robot was not live"
    ),
    "false_report_mm": "reported tip {} mm off the true one, beyond the golden run",
}
"""What is told where it is beyond the limit; the sizes of the other hazards stand with their
beginning.
"""


def _distances(arm: str, series: Series) -> list[str]:
    """How far the arm's true tip was from the nominal model and from the golden run, and when."""
    lines = []
    for other, name in (("model_position", "nominal model"), ("golden_tip", "golden run")):
        if f"{arm}/tip" in series and f"{arm}/{other}" in series:
            distance = 1e3 * np.linalg.norm(
                np.asarray(series[f"{arm}/tip"]) - series[f"{arm}/{other}"], axis=1
            )
            if np.isfinite(distance).any():
                ms = int(np.nanargmax(distance))
                far = wording.number(float(distance[ms]))
                lines.append(f"true {arm} tip {far} mm off the {name}, at {wording.count(ms)} ms")
    return lines

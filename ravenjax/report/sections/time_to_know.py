"""Section "Time to know": how soon after the first effect the cue comes and a check raises an
alarm.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ravenjax.document.chart import Chart
from ravenjax.document.palette import CUE, RESPONSE, SAME
from ravenjax.report.data.runs import Runs
from ravenjax.report.drawing import incidence_curve, log_time, share_axis
from ravenjax.report.sections import Section, answers, tables
from ravenjax.stats.latency import Incidence, incidence


def incidence_curves(runs: Runs, known: Incidence) -> tuple[Chart | None, dict[str, Any]]:
    """Return a chart of how soon the cue comes and a check reports after the first effect, and its
    numbers.

    One run of each fault counts. Return None if no fault had an effect. `known`: the delay until
    anyone could know of an unintended motion.
    """
    numbers: dict[str, Any] = {}
    for key, column in (("cue", "warned_ms"), ("told", "told_ms")):
        delays, early = tables.delays(runs, column)
        numbers[key] = {"curve": incidence(delays), "early": early}
    named = (
        ("haptic cue", CUE, numbers["cue"]["curve"]),
        ("alarm or stop by a check", RESPONSE, numbers["told"]["curve"]),
        ("first of all, for unintended motions", SAME, known),
    )
    end_ms = runs.manifest.duration_ms
    curves = [
        incidence_curve(
            one, f"{name} ({one.events:,} of {one.n:,})", colour, end_ms, runs.sampled()
        )
        for name, colour, one in named
        if one.n
    ]
    if not curves:
        return None, numbers
    share = share_axis("share of faults", curves)
    return Chart("How soon", log_time(end_ms), share, tuple(curves)), numbers


def _content(runs: Runs, _: Path) -> dict[str, Any]:
    curves, timing = incidence_curves(runs, runs.once(answers.knowledge).delay)
    return {
        "curves": curves,
        "timing": timing,
    }


SECTIONS = (Section("time", "Time to know", 40, _content),)

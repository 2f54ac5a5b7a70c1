"""Section "Time to know": how soon after a fault's first effect haptic cues and alarms come."""

from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.document.palette import CUE, RESPONSE, SAME
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import answers, tables
from ravenjax.stats.latency import incidence_curve

FIRST_MS = 1.0
"""Start of the logarithmic time axis, in ms. Times are whole milliseconds."""


def incidence_curves(runs: Runs) -> tuple[Chart | None, dict[str, int]]:
    """Return a chart of the shares of faults with a cue, an alarm and a report, over time.

    Time is counted from the fault's first effect. One run of each fault counts. A report is the
    first cue or alarm of any kind. Its share is of the faults with an unintended motion. The chart
    is None if no cue and no alarm ever came. Also return how many faults each curve leaves out
    because the event came before the first effect.
    """
    cue, early_cue = tables.event_delays(runs, "warned_ms")
    alarm_delays, early_alarms = tables.event_delays(runs, "told_ms")
    end_ms = float(runs.manifest.duration_ms)
    curves = []
    for name, colour, delays in (
        ("haptic cue", CUE, incidence_curve(cue)),
        ("alarm or stop by a check", RESPONSE, incidence_curve(alarm_delays)),
        ("cue or alarm, unintended motions", SAME, runs.once(answers.detection_answers).delay),
    ):
        if delays.events:
            # Enumerated faults have no confidence band.
            edges = (delays.low, delays.high) if runs.sampled() else ()
            label = f"{name}, in {delays.events:,} of {delays.n:,} faults"
            curve = (delays.time, delays.fraction)
            curves.append(Curve.steps(label, colour, *curve, *edges, start=FIRST_MS, end=end_ms))
    most = max((float(curve.y.max()) for curve in curves), default=0.0)
    ends = FIRST_MS, max(end_ms, 10 * FIRST_MS)
    chart = Chart(
        "How soon",
        ChartAxis("time after the fault's first effect, ms", *ends, log=True, unit="ms"),
        ChartAxis("share of faults", 0.0, min(1.0, 1.1 * most) if most else 1.0, share=True),
        tuple(curves),
    )
    return chart if curves else None, {"cue": early_cue, "check": early_alarms}


SECTIONS = {
    "time": lambda runs, _: dict(zip(("curves", "early"), incidence_curves(runs), strict=True))
}

"""Describes how one run's fault propagates to failure, in sentences, tables and a chart."""

import numpy as np
from matplotlib.figure import Figure

from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots
from ravenjax.document.drawing import print_figure
from ravenjax.document.palette import CUE, RESPONSE, SAME
from ravenjax.report import wording
from ravenjax.report.run.chain import Chain

ROW = 15  # px per signal
# least margin of the time axis before the first and after the last event
MARGIN_MS = 8


def chain_title(one: Chain) -> str:
    """Return the title, which names the run."""
    return f"run {one.run_id} · {one.verdict}"


def chain_sentences(one: Chain) -> list[str]:
    """Return the chain as sentences. The last one names where a check could detect the fault."""
    return wording.fill_template("chain.txt.j2", chain=one)


def chain_timeline(one: Chain) -> Chart | None:
    """Return a chart with a row for each signal in the robot's order; None if no signal differs.

    Marks show when a signal differs and when it leaves its range. Events of the run are vertical
    lines.
    """
    if not one.links:
        return None
    differs = np.array([link.differs_ms for link in one.links], float)
    leaving = [(place, link) for place, link in enumerate(one.links) if link.leaves_ms >= 0]
    places, leaves, since = (
        np.array([(place, link.leaves_ms, link.differs_ms) for place, link in leaving], float)
        .reshape(-1, 3)
        .T
    )
    moments = [
        ("fault", one.fault_ms, "series3"),
        ("cue", one.cue_ms, CUE),
        ("alarm", one.told_ms, RESPONSE),
        (one.hazard, one.harm_ms, "series6"),
    ]
    moments = [moment for moment in moments if moment[1] >= 0]
    every = np.concatenate([differs, leaves, [ms for _, ms, _ in moments]])
    margin = max(MARGIN_MS, 0.04 * float(every.max() - every.min()))
    low, high = max(0.0, float(every.min()) - margin), float(every.max()) + margin
    upright = np.array([-0.5, len(one.links) - 0.5])
    layers = ["", *(link.layer for link in one.links)]
    names = (
        link.signal if link.layer == layer else f"{link.layer} · {link.signal}"
        for link, layer in zip(one.links, layers, strict=False)
    )
    return Chart(
        chain_title(one),
        ChartAxis("time, ms", low, high, unit="ms"),
        ChartAxis("signals, in the robot's order", 0, len(one.links), names=tuple(names)),
        (
            *(
                Curve(f"{name}, {_ms(ms)}", colour, np.array([ms, ms], float), upright)
                for name, ms, colour in moments
            ),
            Dots(
                "differs in any bit",
                SAME,
                differs,
                np.arange(len(one.links), dtype=float),
                tips=tuple(
                    f"{link.signal}, {link.differs_in} differs at {_ms(link.differs_ms)}"
                    for link in one.links
                ),
            ),
            Dots(
                "leaves its normal range",
                "series2",
                leaves,
                places,
                tips=tuple(
                    f"{link.signal}, {link.leaves_in} out of its range at {_ms(link.leaves_ms)}"
                    for _, link in leaving
                ),
                x_low=since,
                x_high=leaves,
                diamond=True,
            ),
        ),
        height=ROW * len(one.links),
    )


def timeline_figure(one: Chain) -> Figure | None:
    """Return the timeline as a figure; None if no signal differs."""
    chart = chain_timeline(one)
    first, *_, last = chain_sentences(one)
    return None if chart is None else print_figure([chart], 7.6, title=f"{first}\n{last}")


def _ms(value: int) -> str:
    return f"{wording.format_count(value)} ms"

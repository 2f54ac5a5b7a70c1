"""Describes how one run's fault propagates to failure, in sentences, tables and a chart."""

import numpy as np
from matplotlib.figure import Figure

from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots
from ravenjax.document.drawing import print_figure
from ravenjax.document.palette import CUE, RESPONSE, SAME
from ravenjax.report import wording
from ravenjax.report.run.chain import Chain

ROW_PX = 15  # px per signal
# least margin of the time axis before the first and after the last event
MARGIN_MS = 8


def chain_title(chain: Chain) -> str:
    """Return the title, which names the run."""
    return f"run {chain.run_id} · {chain.verdict}"


def chain_sentences(chain: Chain) -> list[str]:
    """Return the chain as sentences. The last sentence names a signal that a check could test."""
    return wording.fill_template("chain.txt.j2", chain=chain)


def chain_timeline(chain: Chain) -> Chart | None:
    """Return a chart with a row for each signal in the robot's order; None if no signal differs.

    Marks show when a signal differs and when it leaves its range; vertical lines are events.
    """
    if not chain.links:
        return None
    differs = np.array([link.differs_ms for link in chain.links], float)
    # Signals that left their normal range: row in the chart, and times.
    visible = [(row, link) for row, link in enumerate(chain.links) if link.leaves_ms >= 0]
    rows_and_times = [(row, link.leaves_ms, link.differs_ms) for row, link in visible]
    rows, leaves, differs_before = np.array(rows_and_times, float).reshape(-1, 3).T
    moments = [
        ("fault", chain.fault_ms, "series3"),
        ("cue", chain.cue_ms, CUE),
        ("alarm", chain.told_ms, RESPONSE),
        (chain.hazard, chain.harm_ms, "series6"),
    ]
    moments = [moment for moment in moments if moment[1] >= 0]
    all_times = np.concatenate([differs, leaves, [ms for _, ms, _ in moments]])
    margin = max(MARGIN_MS, 0.04 * float(all_times.max() - all_times.min()))
    low, high = max(0.0, float(all_times.min()) - margin), float(all_times.max()) + margin
    full_height = np.array([-0.5, len(chain.links) - 0.5])
    # Only the first signal of a layer has the layer's name.
    layers_before = ["", *(link.layer for link in chain.links)]
    names = tuple(
        link.signal if link.layer == before else f"{link.layer} · {link.signal}"
        for link, before in zip(chain.links, layers_before, strict=False)
    )
    differs_tips = tuple(
        f"{link.signal}, {link.differs_in} differs at {_format_ms(link.differs_ms)}"
        for link in chain.links
    )
    leaves_tips = tuple(
        f"{link.signal}, {link.leaves_in} out of its range at {_format_ms(link.leaves_ms)}"
        for _, link in visible
    )
    order = np.arange(len(chain.links), dtype=float)
    marks = (
        *(
            Curve(f"{name}, {_format_ms(ms)}", colour, np.array([ms, ms], float), full_height)
            for name, ms, colour in moments
        ),
        Dots("differs in any bit", SAME, differs, order, tips=differs_tips),
        # A horizontal bar goes from the time at which the signal differs to the dot.
        Dots(
            "leaves its normal range",
            "series2",
            *(leaves, rows, differs_before, leaves),
            tips=leaves_tips,
            diamond=True,
        ),
    )
    x_axis = ChartAxis("time, ms", low, high, unit="ms")
    y_axis = ChartAxis("signals, in the robot's order", 0, len(chain.links), names=names)
    return Chart(chain_title(chain), x_axis, y_axis, marks, ROW_PX * len(chain.links))


def timeline_figure(chain: Chain) -> Figure | None:
    """Return the timeline as a figure; None if no signal differs."""
    chart = chain_timeline(chain)
    first, *_, last = chain_sentences(chain)
    return None if chart is None else print_figure([chart], 7.6, title=f"{first}\n{last}")


def _format_ms(value: int) -> str:
    return f"{wording.format_count(value)} ms"

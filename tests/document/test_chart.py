"""A chart: what it says of itself in words, and that page and print draw its values."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from ravenjax.document import drawing
from ravenjax.document.chart import RESOLUTION, Chart, ChartAxis, Curve

TIME = ChartAxis("time, ms", 1.0, 1000.0, log=True, unit="ms")
SHARE = ChartAxis("share of faults", 0.0, 0.8, share=True)
CURVE = Curve.steps(
    "cue",
    "cue",
    [0, 1, 10, 100],
    [0, 0.25, 0.5, 0.75],
    [0, 0.2, 0.4, 0.7],
    [0, 0.3, 0.6, 0.8],
    start=1,
    end=1000,
)
CHART = Chart("How soon", TIME, SHARE, (CURVE,), height=200)


def drawn(chart, kind="wide"):
    """The root of the drawing, and its groups by series: their classes, and points of paths."""
    root = ET.fromstring(str(drawing.page_drawings(chart, "n", [kind])))
    groups = {}
    for part in root.iter("g"):
        if part.get("data-series"):
            points = [
                np.array(re.findall(r"[ML] (-?[\d.]+) (-?[\d.]+)", path.get("d")), float)
                for path in part.iter("path")
            ]
            groups.setdefault(part.get("data-series"), []).append((part.get("class"), points))
    return root, groups


@pytest.mark.parametrize("kind", ["wide", "narrow"])
def test_the_page_draws_the_values(kind):
    root, groups = drawn(CHART, kind)
    (hit,) = (part for part in root.iter("g") if part.get("class") == "hit")
    box = np.array(
        re.findall(r"[ML] (-?[\d.]+) (-?[\d.]+)", next(hit.iter("path")).get("d")), float
    )
    (left, top), (right, bottom) = box.min(axis=0), box.max(axis=0)
    band, line = (points[0] for _, points in groups["0"])
    x = 10 ** (3 * (line[:, 0] - left) / (right - left))
    y = 0.8 * (bottom - line[:, 1]) / (bottom - top)
    assert (x[0], y[0]) == pytest.approx((1, 0.25), rel=0.01)
    assert (x[-1], y[-1]) == pytest.approx((1000, 0.75), rel=0.01)
    assert 0.8 * np.ptp(band[:, 1]) / (bottom - top) == pytest.approx(0.8 - 0.2, rel=0.01)


def test_print_draws_the_same_points():
    axes = Figure().subplots()
    drawing.draw_chart(CHART, axes)
    (line,) = axes.lines
    np.testing.assert_array_equal(line.get_xdata(), CURVE.x)
    np.testing.assert_array_equal(line.get_ydata(), CURVE.y)
    assert axes.get_xlim() == (1, 1000) and axes.get_ylim() == (0, 0.8)
    assert axes.get_xscale() == "log"


def test_a_step_curve_has_few_points_and_loses_no_step():
    time = np.arange(10_000.0)
    values = 0.5 * np.linspace(0, 1, 10_000) ** 0.5
    values[5000:] += 0.01
    curve = Curve.steps("one", "cue", time, values, end=20_000)
    assert len(curve.x) < 2 / RESOLUTION and curve.x[-1] == 20_000
    there = np.array([curve.at(x)[0] for x in time])
    assert np.abs(there - values).max() <= RESOLUTION * values.max()
    assert curve.at(5000.0)[0] - curve.at(4999.9)[0] == pytest.approx(0.01, abs=RESOLUTION)


def test_its_numbers_as_a_table():
    (table,) = CHART.numbers()
    assert table.columns == ("", "time, ms: 1 ms", "10 ms", "100 ms", "1,000 ms")
    percent = "\u202f%"
    assert table.rows[0][0] == "cue"
    assert table.rows[0][2] == f"50.0{percent} (40.0{percent} to 60.0{percent})"
    assert "How soon" in CHART.words() and "share of faults over time, ms, of cue" in CHART.words()


def test_every_drawing_tells_what_it_is_and_no_name_is_markup():
    evil = Chart('<b>"', TIME, SHARE, (Curve('<script>"', "cue", CURVE.x, CURVE.y, step=True),))
    for chart in (CHART, evil):
        root, _ = drawn(chart)
        assert root.get("role") == "img" and root.get("aria-label") == chart.words()
        assert root.get("aria-describedby") == "n"

"""A chart: what it says of itself in words, and that page and print draw the same values."""

from __future__ import annotations

import itertools
import json
import re
import xml.etree.ElementTree as ET

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from ravenjax.document import axes, palette, svg
from ravenjax.document.chart import Bars, Chart, ChartAxis, Curve, Dots
from ravenjax.document.steps import steps

matplotlib.use("agg")

TIME = ChartAxis("time, ms", 1.0, 1000.0, log=True, unit="ms")
SHARE = ChartAxis("share of faults", 0.0, 0.8, share=True)
CURVE = Curve.of(
    steps(
        [0, 1, 10, 100],
        [0, 0.25, 0.5, 0.75],
        [0, 0.2, 0.4, 0.7],
        [0, 0.3, 0.6, 0.8],
        start=1,
        end=1000,
    ),
    "cue",
    "cue",
)
CHART = Chart("How soon", TIME, SHARE, (CURVE,), height=200)


def drawn(chart, kind="wide"):
    """Left and top of the area, its size, and the root of the drawing."""
    text = next(
        one for one in str(svg.drawings(chart, "n")).split("\n") if f'class="{kind}"' in one
    )
    root = ET.fromstring(text)
    area = next(part for part in root.iter("svg") if part.get("class") == "area")
    return root, area, {name: float(area.get(name)) for name in ("x", "y", "width", "height")}


def corners_of(path):
    """Points of a path of M, l, h and v."""
    x = y = 0.0
    for letter, numbers in re.findall(r"([Mlhv])(-?[\d.]+(?:,-?[\d.]+)?)", path):
        parts = [float(part) for part in numbers.split(",")]
        if letter == "M":
            x, y = parts
        elif letter == "l":
            x, y = x + parts[0], y + parts[1]
        elif letter == "h":
            x += parts[0]
        else:
            y += parts[0]
        yield x, y


@pytest.mark.parametrize("kind", ["wide", "narrow"])
def test_the_page_draws_the_values(kind):
    _, area, box = drawn(CHART, kind)
    line = next(part for part in area.iter("path") if part.get("class") == "line")
    points = list(corners_of(line.get("d")))
    x = [10 ** (3 * at / box["width"]) for at, _ in points]
    y = [0.8 * (1 - at / box["height"]) for _, at in points]
    assert (x[0], y[0]) == pytest.approx((1, 0.25), rel=0.01)
    assert (x[-1], y[-1]) == pytest.approx((1000, 0.75), rel=0.01)
    rise = [b for a, b in itertools.pairwise(points) if a[0] == b[0]]
    assert [0.8 * (1 - at / box["height"]) for _, at in rise] == pytest.approx(
        [0.5, 0.75], rel=0.01
    )


def test_the_band_goes_along_the_upper_edge_and_back_along_the_lower():
    _, area, box = drawn(CHART)
    band = next(part for part in area.iter("path") if part.get("class") == "band")
    points = list(corners_of(band.get("d")))
    y = [0.8 * (1 - at / box["height"]) for _, at in points]
    half = len(points) // 2
    assert y[0] == pytest.approx(0.3, abs=0.005) and y[half - 1] == pytest.approx(0.8, abs=0.005)
    assert y[half] == pytest.approx(0.7, abs=0.005) and y[-1] == pytest.approx(0.2, abs=0.005)
    assert points[0][0] == pytest.approx(points[-1][0]) and points[half - 1][0] == points[half][0]


def test_print_draws_the_same_points():
    figure = Figure()
    axis = figure.subplots()
    axes.draw(CHART, axis)
    (line,) = axis.lines
    np.testing.assert_array_equal(line.get_xdata(), CURVE.x)
    np.testing.assert_array_equal(line.get_ydata(), CURVE.y)
    assert (
        axis.get_xlim() == (1, 1000) and axis.get_ylim() == (0, 0.8) and axis.get_xscale() == "log"
    )
    assert [text.get_text() for text in axis.get_yticklabels()] == SHARE.labels(
        SHARE.ticks(axes.TICKS)
    )


def test_a_reader_of_values_gets_the_curves():
    told = json.loads(svg.values(CHART))
    assert told["curves"] == [
        {"name": "cue", "step": True, "x": CURVE.x.tolist(), "y": CURVE.y.tolist()}
    ]
    assert told["x"]["log"] and told["y"]["share"]


def test_its_numbers_as_a_table():
    (table,) = CHART.numbers()
    assert table.columns == ("", "time, ms: 1 ms", "10 ms", "100 ms", "1,000 ms")
    percent = "\u202f%"
    assert table.rows[0][0] == "cue"
    assert table.rows[0][2] == f"50.0{percent} (40.0{percent} to 60.0{percent})"
    assert "How soon" in CHART.words() and "share of faults over time, ms, of cue" in CHART.words()


def test_marks_and_bars_in_numbers():
    dots = Dots(
        "sets",
        "cue",
        np.array([0.0]),
        np.array([0.05]),
        np.array([0.0]),
        np.array([396.0]),
        tips=("2 mm",),
    )
    bars = Bars(
        "first", "cue", np.array([-50.0]), np.array([0.0]), np.array([3.0]), np.array([10.0])
    )
    hourly, lead, runs = (
        ChartAxis("per hour", 0, 400),
        ChartAxis("lead, ms", -50, 50, unit="ms"),
        ChartAxis("runs", 0, 10, whole=True),
    )
    (marks,) = Chart("Trade", hourly, SHARE, (dots,)).numbers()
    assert marks.rows == [("2 mm", "0 (0 to 396)", "5.0\u202f%")]
    (bins,) = Chart("Lead", lead, runs, (bars,)).numbers()
    assert bins.rows == [("first", "−50 ms to 0 ms", "7")]


def test_every_drawing_tells_what_it_is():
    root, _, _ = drawn(CHART)
    assert root.get("role") == "img" and root.get("aria-label") == CHART.words()
    assert root.get("aria-describedby") == "n"


def test_names_are_escaped():
    evil = Chart('<b>"', TIME, SHARE, (Curve('<script>"', "cue", CURVE.x, CURVE.y, step=True),))
    text = str(svg.drawings(evil, "n"))
    assert "<script>" not in text and "<b>" not in text
    for one in text.split("\n"):
        ET.fromstring(one)


def test_places_have_names_and_long_ones_are_cut():
    names = ("USB out, motors", "a name that is far too long for the margin of a chart")
    up = ChartAxis("faults", -0.5, 1.5, names=names)
    dots = Dots("release", "series0", np.array([1.0, 2.0]), np.array([0.0, 1.0]))
    root, _, box = drawn(Chart("Spared", ChartAxis("mm", 0, 4), up, (dots,), height=100))
    texts = [part.text for part in root.iter("text")]
    assert names[0] in texts and names[1] not in texts and any(text.endswith("…") for text in texts)
    centres = [float(part.get("cy")) for part in root.iter("circle")]
    assert centres == pytest.approx([box["height"] * 0.25, box["height"] * 0.75])


def test_what_is_hidden_at_first_is_drawn_but_not_shown_and_not_printed():
    hidden = Curve("other", "series1", CURVE.x, CURVE.y / 2, step=True, visible=False)
    chart = Chart("Two", TIME, SHARE, (CURVE, hidden))
    root, _, _ = drawn(chart)
    groups = {
        part.get("data-series"): part.get("class")
        for part in root.iter("g")
        if part.get("data-series")
    }
    assert groups == {"0": "mark", "1": "mark off"} and [
        visible for *_, visible in chart.legend()
    ] == [True, False]
    axis = Figure().subplots()
    axes.draw(chart, axis)
    assert len(axis.lines) == 1


def test_texts_beside_marks_do_not_overlap():
    names = ("2 mm", "3 mm", "4 mm", "5 mm")
    dots = Dots("sets", "cue", np.zeros(4), np.array([0.050, 0.055, 0.060, 0.060]), texts=names)
    root, _, _ = drawn(Chart("Trade", ChartAxis("per hour", 0, 1), SHARE, (dots,)))
    found = {part.text: float(part.get("y")) for part in root.iter("text") if "mm" in part.text}
    assert list(found) == ["4 mm, 5 mm", "3 mm", "2 mm"]  # of one place in a row
    assert min(np.diff(sorted(found.values()))) >= svg.LINE - 0.11


def test_colours_differ_and_every_name_has_both_schemes():
    light = [palette.PALETTE[name].light for name in palette.SERIES]
    assert len(set(light)) == len(light)
    for name in palette.PALETTE:
        assert palette.css().count(f"--{name}: #") == 2

"""The figure of one run: every panel, marker and window is drawn, the same bytes each time."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from ravenjax.report.run.plot import trace_plot
from ravenjax.robots.raven2.arms import JOINTS

TICKS = 3000


def series():
    """One arm, whose shoulder gets most current while the fault acts."""
    random, time = np.random.default_rng(5), np.arange(TICKS)
    made = {
        "runlevel": np.where(time < 1700, 3, 0),
        "surgeon_mode": (time > 100) * 1,
        "fault0_active": (time >= 1200) & (time < 1500),
    }
    for name in ("model_position", "position", "tip"):
        made[f"gold/{name}"] = random.normal(0, 0.01, (TICKS, 3))
    made["gold/cue_force"] = np.abs(random.normal(0, 1, (TICKS, 1)))
    made["gold/boards_cnt"] = random.integers(-100, 100, (TICKS, 7)) * np.arange(1, 8)
    made["gold/boards_cnt"][made["fault0_active"], 0] = 14000
    return made


EVENTS = {"cue": 1275, "stopped: overdrive": 1700, "never": -1}


@pytest.fixture
def figures(monkeypatch):
    """The figures that are drawn."""
    drawn, save = [], Figure.savefig

    def saved(figure, *given, **named):
        drawn.append(figure)
        save(figure, *given, **named)

    monkeypatch.setattr(Figure, "savefig", saved)
    return drawn


def lines(axes):
    """Name of each line that has one -> its y values."""
    return {
        line.get_label(): line.get_ydata()
        for line in axes.lines
        if not line.get_label().startswith("_")
    }


@pytest.mark.parametrize(("suffix", "begins"), [(".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_values_events_and_windows_stand_where_they_belong(tmp_path, figures, suffix, begins):
    given = series()
    path = trace_plot(given, tmp_path / f"run{suffix}", events=EVENTS)
    assert path.read_bytes().startswith(begins)
    (figure,) = figures
    error, force, dac, state = figure.axes
    for label, name in (("gold, true", "tip"), ("gold, as reported", "position")):
        off = given[f"gold/{name}"] - given["gold/model_position"]
        np.testing.assert_allclose(lines(error)[label], 1e3 * np.sqrt((off**2).sum(axis=1)))
    np.testing.assert_allclose(lines(force)["force, gold"], given["gold/cue_force"][:, 0])
    peaks = np.abs(given["gold/boards_cnt"]).max(axis=0)
    assert set(JOINTS) & set(lines(dac)) == {
        JOINTS[joint] for joint in np.argsort(peaks)[-3:]
    } and "shoulder" in lines(dac)
    np.testing.assert_array_equal(lines(dac)["shoulder"], given["gold/boards_cnt"][:, 0])
    np.testing.assert_array_equal(lines(state)["run level"], given["runlevel"])
    for axes in figure.axes:
        upright = [line.get_xdata()[0] for line in axes.lines if np.ptp(line.get_xdata()) == 0.0]
        assert upright == [1.275, 1.7], "events, s"
        (window,) = (line for line in axes.lines if line.get_label() == "fault")
        np.testing.assert_allclose(window.get_xdata(), [1.2, 1.5], err_msg="the fault, s")
    assert lines(error)["cue at 3 mm"].tolist() == [3.0, 3.0]

"""`ravenjax motion`, and what `ravenjax run` says of a recorded operator."""

import numpy as np
import pandas as pd
import pytest

from ravenjax.cli import USER_ERROR

HOME_MM = np.array([-77.946997893, -25.265555299, 13.225627957])  # gold's tip at home, frame 0


def frame(hz=30.0, seconds=3.0):
    time_s = np.arange(round(seconds * hz)) / hz
    place = HOME_MM + 5.0 * np.sin(2.0 * np.pi * time_s / 3.0)[:, None] * [[0.0, 1.0, 0.0]]
    return pd.DataFrame(
        {"t_ms": time_s * 1e3} | {f"gold_{a}_mm": place[:, i] for i, a in enumerate("xyz")}
    )


@pytest.fixture
def hands(tmp_path):
    path = tmp_path / "hands.csv"
    frame().assign(note="x").to_csv(path, index=False)
    return path


@pytest.mark.slow
def test_a_table_and_a_picture(command_line, hands, tmp_path):
    code, out, err = command_line(
        "motion", hands, "--out", tmp_path / "pictures", "--set", "operator.cutoff_hz=3"
    )
    assert code == 0, err
    assert "90 rows, sha256" in out and "30 rows per second" in out, out
    assert "not read: note" in out and "the whole recording is inside" in out, out
    svg, png = (tmp_path / "pictures" / f"hands.{kind}" for kind in ("svg", "png"))
    assert png.read_bytes()[:4] == b"\x89PNG"
    drawn = svg.read_text()
    assert drawn.count(">recorded<") == 1
    assert "replayed, gold" in drawn and "tip speed, mm/s" in drawn
    first = svg.read_bytes()
    command_line("motion", hands, "--out", tmp_path / "pictures", "--set", "operator.cutoff_hz=3")
    assert svg.read_bytes() == first


def test_what_cannot_be_replayed_is_drawn_and_refused(command_line, tmp_path):
    path = tmp_path / "spiked.csv"
    spiked = frame()
    spiked.loc[45, "gold_z_mm"] += 60.0
    spiked.to_csv(path, index=False)
    code, out, err = command_line("motion", path, "--out", tmp_path)
    assert code == USER_ERROR and err.count("error:") == 1
    assert "row 45 (1.500 s, gold): 60 mm" in err
    assert (tmp_path / "spiked.png").is_file() and "wrote" in out
    assert ">jump<" in (tmp_path / "spiked.svg").read_text()


@pytest.mark.slow
def test_a_run_says_what_it_does_with_the_hands(command_line, hands, tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(
        '[campaign]\nname = "small"\nduration_s = 1.2\n[operator]\nfile ='
        ' "hands.csv"\n[[group]]\nname = "free"\n'
    )
    code, out, err = command_line("run", path, "--out", tmp_path / "out", "--engine", "simd")
    assert code == 0, err
    assert "column t_ms: 30 rows per second" in out
    assert "none: tremor and noise are replayed as recorded" in out
    assert out.index("Recorded operator") < out.index("engine:")
    page = (tmp_path / "out" / "report.html").read_text()
    assert 'id="operator"' in page

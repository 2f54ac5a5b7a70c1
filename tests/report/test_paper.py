"""Figures for print."""

import pytest
import reacting_results as reacting
import synthetic_results as synthetic

from ravenjax.report import paper


@pytest.mark.slow
def test_main_figures_as_svg_and_pdf_alike_each_time(tmp_path):
    frame = reacting.frame(150)
    folder = synthetic.folder(tmp_path / "results", frame, reacting.manifest(len(frame)))
    paths = paper.write_figures(folder, tmp_path / "one")
    names = [path.name for path in paths]
    assert names == [
        f"{name}.{kind}"
        for name in ("verdicts", "time_to_know", "roc", "tradeoff")
        for kind in ("svg", "pdf")
    ]
    heads = {".svg": b"<?xml", ".pdf": b"%PDF"}
    assert all(path.read_bytes().startswith(heads[path.suffix]) for path in paths)
    again = paper.write_figures(folder, tmp_path / "two")
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in again]
    verdicts = paths[0].read_text()
    assert "unintended motion, cue" in verdicts and "packet_position" in verdicts

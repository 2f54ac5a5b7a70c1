"""`explore`: what cannot become a page is refused in words."""

from __future__ import annotations

from ravenjax.cli import main


def test_a_campaign_that_is_not_there_is_told_of(capsys, tmp_path):
    assert main(["explore", str(tmp_path / "none.toml")]) == 2
    assert "none.toml" in capsys.readouterr().err


def test_a_campaign_with_noise_is_refused_before_anything_is_written(capsys, tmp_path):
    file = tmp_path / "noisy.toml"
    file.write_text(
        "[campaign]\nname = 'noisy'\nduration_s = 0.2\nnoise = true\n[operator]\nmotion = 'still'\n"
        "[[group]]\nname = 'a'\n[group.parameters]\nplant.gold.encoder_noise = 2\n"
    )
    page = tmp_path / "page.html"
    assert main(["explore", str(file), "-o", str(page)]) == 2
    assert "drawn anew in each run" in capsys.readouterr().err
    assert not page.exists()

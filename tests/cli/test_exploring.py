"""`explore`: what cannot become a page is refused in words."""

from ravenjax.cli import main


def test_a_campaign_with_noise_is_refused_before_anything_is_written(capsys, tmp_path):
    file = tmp_path / "noisy.toml"
    file.write_text(
        "[campaign]\nname = 'noisy'\nduration_s = 0.2\nnoise = true\n[operator]\nmotion = 'still'\n"
        "[[group]]\nname = 'a'\n[group.parameters]\nplant.gold.encoder_noise = 2\n"
    )
    page = tmp_path / "page.html"
    assert main(["explore", str(file), "-o", str(page)]) == 2
    assert "drawn again in each run" in capsys.readouterr().err
    assert not page.exists()

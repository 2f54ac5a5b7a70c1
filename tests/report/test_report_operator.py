"""The report's section on a recorded operator: what became of it, in numbers and as a figure."""

import numpy as np
import pytest
import synthetic_results as synthetic
from rendered_page import Page, rendered, words

from ravenjax.store.motion.options import ReplayOptions
from ravenjax.store.motion.summary import ArmSummary, MotionSummary, line

TIME_S = np.arange(4000) * 1e-3
PLACE = np.stack(
    [-0.078 + 0.002 * np.sin(TIME_S), -0.025 + 0.01 * np.cos(TIME_S), 0.013 + 0.0 * TIME_S], axis=1
)
PLACE[1234, 2] += 0.05  # one sample


def summary(**changes):
    plain = {
        "file": "/data/hands <1>.csv",
        "sha256": "ab" * 32,
        "rows": 4000,
        "clock": "column t_ms",
        "read": ("gold_x_mm", "t_ms"),
        "ignored": ("note",),
        "notes": ("a note",),
        "duration_s": 3.999,
        "rate_hz": 1000.0,
        "steps_ms": (0.9, 1.0, 1.1),
        "gaps": 0,
        "longest_gap": None,
        "spikes": ("row 1234 (1.234 s, gold): 50 mm",),
        "options": ReplayOptions(window_s=(0.5, 2.75), spikes="replay"),
        "outside": ((3.0, 3.5), (0.1, 0.2)),
        "outside_share": 0.15,
        "window_s": (0.5, 2.749),
        "campaign_s": 3.0,
        "end_s": None,
        "turns": 0,
        "pedal": "down",
        "pedal_down": 0.93,
        "scale": 0.1,
        "arms": (
            ArmSummary(
                arm="gold",
                orientation="recorded",
                jaws="home",
                inside=0.85,
                extent_mm=(4.0, 10.0, 50.0),
                path_mm=120.0,
                fastest_mm_s=80.0,
                distance_mm=(80.0, 95.0),
            ),
        ),
        "lines": (
            line("gold", "recorded", TIME_S, PLACE),
            line("gold", "replayed", TIME_S[500:2750], PLACE[500:2750]),
        ),
    }
    return MotionSummary(**(plain | changes))


@pytest.mark.slow
def test_a_page_of_a_recorded_operator_says_what_became_of_it():
    manifest = synthetic.manifest(200).model_copy(update={"operator": summary()})
    page = Page(rendered(synthetic.frame(200), manifest))
    text = words(page)
    assert "operator" in page.ids and "#operator" in page.targets
    assert (
        "Recorded hands: hands <1>.csv. 0.50 to 2.75 s of 4.00 s are replayed in every run, and the"
        " tip moves as" in text
    )
    assert (
        "15 % of the recording cannot be replayed" in text
        and "[3.000, 3.500], [0.100, 0.200] s" in text
    )
    assert (
        "row 1234 (1.234 s, gold): 50 mm" in text and "not read: note" in text and "a note" in text
    )


@pytest.mark.slow
def test_a_page_of_a_generated_operator_has_no_such_section():
    page = Page(rendered(synthetic.frame(200), synthetic.manifest(200)))
    assert "operator" not in page.ids and "#operator" not in page.targets

"""What each role sees: no hazard for the operator, nothing of the cue for anyone where the
session is blinded.
"""

import numpy as np
import pytest

from ravenjax.train.page.hub import Visibility
from ravenjax.train.protocol import Frame, FrameLayout

LAYOUT = FrameLayout.of(("gold", "green"))
HEADER = {
    "name": "x",
    "hazards": [1],
    "group": "a",
    "cue": True,
    "seed": 3,
    "scenario": {"hazard": 1},
    "task": {},
    "summary": {},
}


def seen(role, blinded, cue_on=1.0):
    row = np.arange(1, LAYOUT.size + 1, dtype=np.float32)
    frame = Frame(LAYOUT, row)
    frame["cue_on"], frame["hazard"], frame["fault_active"] = cue_on, 2, 1
    peaks = np.array([[4.0, 0.05, 7, 8, 9], [1.0, 0.02, 7, 8, 9]], np.float32)
    before = row.copy()
    numbers = np.frombuffer(Visibility(LAYOUT, role, blinded).frame(row, peaks), np.float32)
    np.testing.assert_array_equal(row, before)  # the ring's row is others' too
    return numbers[:10].reshape(2, 5), Frame(LAYOUT, numbers[10:]), Frame(LAYOUT, before)


@pytest.mark.parametrize("role", ["operator", "watcher"])
@pytest.mark.parametrize("blinded", [False, True])
def test_an_operator_sees_no_hazard(role, blinded):
    _, frame, _ = seen(role, blinded)
    assert frame.number("hazard") == -1 and frame.number("fault_active") == 0
    assert frame.number("trips") == frame.number("golden_cue") == frame.number("halted_ms") == 0
    for name in ("unintended_mm", "unintended_off_mm", "loss_mm", "false_report_mm", "known_mm"):
        assert frame.number(f"gold/{name}") == frame.number(f"green/{name}") == 0, name


def test_a_blinded_operator_sees_the_field_alone():
    peaks, frame, whole = seen("operator", True)
    np.testing.assert_array_equal(frame["gold/model_tip"], whole["gold/tip"])
    np.testing.assert_array_equal(frame["green/model_jpos"], whole["green/link_jpos"])
    assert frame.number("gold/error_mm") == 0 and not peaks[:, 0].any()
    np.testing.assert_array_equal(
        peaks[0, 2:], whole["gold/tip"]
    )  # not where the software wants it
    np.testing.assert_array_equal(frame["gold/tip"], whole["gold/tip"])
    on, off = (seen("operator", True, cue)[1].number("cue_on") for cue in (1, 0))
    assert on == off


@pytest.mark.parametrize(
    ("role", "blinded", "shown"),
    [
        ("operator", False, {"name", "cue", "task"}),
        ("operator", True, {"name", "task"}),
        ("instructor", False, set(HEADER)),
        ("instructor", True, {"name", "hazards", "task"}),
    ],
)
def test_headers_by_role(role, blinded, shown):
    scenario = {"title": "t", "description": "d", "hazard": []}
    told = Visibility(LAYOUT, role, blinded).header(HEADER | {"scenario": scenario})
    assert set(told) == shown | {"title", "description"}

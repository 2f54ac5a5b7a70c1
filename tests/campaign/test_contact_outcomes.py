"""Contact as an outcome of a campaign: columns only where it is on, the same bits from simd and
from C++ as CUDA.
"""

import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines
from tiny_campaign import fault

import ravenjax as rj
from ravenjax.campaign import loading, plan

FAULT = fault(
    "usb_out", "insertion", "overwrite", [-14000, 14000], 320, arm="gold", duration_ms=100
)


def config(contact: bool, arms=("gold",)):
    campaign = {"name": "x", "duration_s": 0.5, "arms": list(arms), "contact": contact}
    groups = [{"name": "free"}, {"name": "a", "fault": [FAULT]}]
    return loading.from_dict(
        {"campaign": campaign, "operator": {"motion": "reach"}, "group": groups}
    )


def test_what_a_fault_presses_is_counted_where_contact_is_on_and_nowhere_else() -> None:
    pressed, plain = (rj.run(config(on), engine="simd") for on in (True, False))
    assert not [name for name in plain if "contact" in name]
    assert pressed["contact_peak_n"].max() > 0.01 and pressed["contact_impulse_n_s"].max() > 0.0
    assert (pressed["contact_vessel_peak_n"] <= pressed["contact_peak_n"] + 1e-6).all()
    assert (pressed["golden_contact_peak_n"] == 0.0).all() and (
        pressed["failed"].astype(str) == ""
    ).all()


@pytest.mark.slow
@pytest.mark.parametrize("arms", [("gold",)])
def test_engines_have_the_same_bits(arms, monkeypatch, tmp_path) -> None:
    real_or_pretended(monkeypatch, tmp_path)
    check_engines(plan.make_plan(config(True, arms)), 3)

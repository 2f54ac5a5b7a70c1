"""The notebook's functions: what they take, and that anything else is one UserError before any
work.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign import runner
from ravenjax.errors import UserError

CAMPAIGN = {
    "campaign": {"name": "x", "duration_s": 0.05},
    "operator": {"motion": "still"},
    "group": [{"name": "a"}, {"name": "b"}],
}


@dataclasses.dataclass
class Broken:
    """Something whose repr fails."""

    def __repr__(self):
        raise RuntimeError


@pytest.mark.parametrize(
    "campaign",
    [None, 5, b"quick", ["quick"], "", Broken(), object()],
    ids=lambda given: type(given).__name__,
)
def test_no_campaign(campaign):
    for call in (rj.load_campaign, rj.run, rj.simulate):
        with pytest.raises(
            UserError,
            match="expected the path of a campaign file or the name of a bundled campaign",
        ):
            call(campaign)


@pytest.mark.parametrize("overrides", ["campaign.seed=1", [1], [None]])
def test_overrides_are_a_list_of_texts(overrides):
    with pytest.raises(UserError, match="expected a list of texts such as"):
        rj.load_campaign(CAMPAIGN, overrides)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"out": 5}, "out is 5, expected the path of a result folder"),
        ({"out": ""}, "out is ''"),
        ({"engine": None}, "engine None is unknown"),
        ({"engine": "cpu"}, "engine 'cpu' is unknown"),
        ({"on_progress": 3}, "on_progress is 3, expected a function"),
        ({"executor": "cloud"}, "unknown executor 'cloud', expected one of local, ray"),
        ({"workers": 0}, "workers is 0, expected 1 or more"),
    ],
)
def test_what_run_does_not_take(given, words, monkeypatch):
    monkeypatch.setattr(runner, "Work", None)
    with pytest.raises(UserError, match=words):
        rj.run(CAMPAIGN, **given)


@pytest.mark.slow
def test_nested_tables_need_not_be_loaded_first():
    table = rj.run(CAMPAIGN, engine="simd")
    assert table["group"].tolist() == ["a", "b"]
    by_index, by_id = (
        rj.simulate(CAMPAIGN, run, "simd") for run in (np.int64(1), table["run_id"][1])
    )
    assert by_index.identical(by_id) and by_index.attrs["group"] == "b"


def test_a_campaign_is_not_changed_by_overrides():
    config = rj.load_campaign(
        CAMPAIGN, ["campaign.seed=7", "group.b.parameters.plant.mass_scale=1.1"]
    )
    assert config.campaign.seed == 7 and "parameters" not in CAMPAIGN["group"][1]


def test_public_names_are_what_their_home_defines():
    assert dir(rj) == sorted([*rj.__all__, "__version__"])
    assert rj.UserError is UserError
    homes = (getattr(rj, name) for name in rj.__all__ if name not in ("faults", "functional"))
    assert all(home.__module__.startswith("ravenjax.") for home in homes)
    with pytest.raises(AttributeError, match="it has Campaign, CampaignConfig"):
        rj.engines_of_war  # noqa: B018


def test_compiled_runs_inside_jit_have_the_bits_of_the_campaign():
    fault = {"site": "usb_out", "channel": ["shoulder", "elbow"], "effect": "overwrite"}
    fault |= {"value": [-9000, 9000], "start_ms": 600, "duration_ms": [10, 40]}
    campaign = {"campaign": {"name": "c", "duration_s": 0.7}, "operator": {"motion": "suture"}}
    campaign |= {"group": [{"name": "dac", "fault": [fault]}]}
    model = rj.functional.load(campaign)
    no_fault = jax.tree.map(lambda leaf: jnp.zeros_like(leaf[0]), model.faults)
    golden = model.run_compiled({}, no_fault, engine="simd").series

    def run(faults, golden):
        return model.run_compiled({}, faults, golden, engine="simd").outcomes["unintended_mm"]

    nested = jax.jit(jax.vmap(jax.vmap(run, (0, None)), (None, 0)))
    expected = rj.run(campaign, engine="simd")["unintended_mm"].to_numpy()
    assert (nested(model.faults, jnp.stack([golden, golden])) == expected).all()
    assert len(set(expected)) == 8
    with pytest.raises(ValueError, match=r"golden has shape \(9, 6\), expected \(700, 6\)"):
        run(no_fault, golden[:9])

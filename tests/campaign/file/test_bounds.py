"""Ranges of parameters: nothing outside one is accepted, everything in it can be run. Each has
one: `test_quantity`.
"""

import pandas as pd
import pytest

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import fixed_axis
from ravenjax.errors import UserError
from ravenjax.numbers import paths
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.arms import ARMS

BASE = {
    "campaign": {"name": "x", "duration_s": 0.01},
    "operator": {"motion": "still"},
    "reaction": {},
    "hand": {},
    "detector": [{"name": "model", "kind": "steps", "threshold": [1, 2, 3]}],
    "group": [{"name": "g"}],
}


def leaves(**campaign):
    """Every parameter of a campaign with these keys: full path -> number."""
    config = loading.from_dict({**BASE, "campaign": {**BASE["campaign"], **campaign}})
    program = plan.make_plan(config).program
    known = dict(paths.path_leaves(program.params, program.setup))
    return {path: float(value) for path, value in known.items()}


@pytest.fixture(scope="module")
def every():
    return (
        leaves(arms=["gold", "green"], contact=True)
        | leaves(software="fork2015")
        | leaves(console="absolute")
    )


@pytest.mark.parametrize(
    "path", ["control.cartesian.lower", "control.cartesian.lower.elbow", "plant.gold.stops.upper"]
)
def test_a_vector_is_checked_against_the_rows_of_all_its_numbers(path):
    """0.5 suits angles and the insertion, 3 rad no insertion in m."""
    assert not any(
        bounds.out_of_range(fixed_axis(0.5), row) for row in bounds.allowed_values(ROBOT, path)
    )
    wrong = [
        bounds.out_of_range(fixed_axis(3.0), row) for row in bounds.allowed_values(ROBOT, path)
    ]
    assert any(wrong) is not path.endswith("elbow")


@pytest.mark.parametrize(
    "path, value, words",
    [
        ("plant.friction_scale", -1, ("got -1, expected 0..100", "opposes motion")),
        ("network.cycles_per_packet", 0, ("got 0, expected 1..1000 cycles, whole",)),
        (
            "network.cycles_per_packet",
            {"uniform": [1, 4]},
            ("uniform may draw fractions", "choice"),
        ),
        ("plant.friction_scale", {"normal": [1, 0.2]}, ("may draw -0.408", "normal = [1, 0.2]")),
        ("haptics.cues.0.threshold_m", 0.02, ("cannot be set", "write [haptics] threshold_mm")),
        ("monitor.limit", 0.02, ("cannot be set", "write [outcomes] limit_mm")),
    ],
)
def test_what_is_out_of_range_is_refused(path, value, words):
    table = {"parameters": {path: value}}
    for key, raw in {
        "parameters": {**BASE, **table},
        "group[0].parameters": {**BASE, "group": [{"name": "g", **table}]},
    }.items():
        config = loading.from_dict(raw)
        with pytest.raises(UserError) as error:
            plan.make_plan(config)
        message = str(error.value)
        assert f"{key}.{path}: " in message and len(message) < 400
        assert all(word in message for word in words), message


def test_the_runs_of_a_list_are_looked_at_too():
    group = {"name": "g", "design": "list", "run": [{}, {"parameters": {"plant.mass_scale": -1}}]}
    with pytest.raises(
        UserError, match=r"group\[0\]\.run\[1\]\.parameters\.plant\.mass_scale: got -1"
    ):
        loading.check_parameters(loading.from_dict({**BASE, "group": [group]}))


def at_the_ends(paths, **own):
    """A short run at each end of the range of each path."""
    groups = [{"name": "free"}]
    for path in sorted(paths):
        for row in bounds.allowed_values(ROBOT, path):
            groups += [
                {"name": f"{path} = {end}", "parameters": {path: end}}
                for end in (row.low, row.high)
            ]
    campaign = {"name": "ends", "duration_s": 0.4, "noise": True, "console": "absolute", **own}
    table = rj.run(
        {**BASE, "campaign": campaign, "operator": {"motion": "reach"}, "group": groups},
        engine="simd",
    )
    assert len(table) == len(groups)
    return table


@pytest.mark.slow
def test_the_ends_of_every_range_can_be_run(every):
    """Whatever the table lets through, the robot's numbers stay numbers."""
    # Not read here, and so refused.
    idle = ("control.teleoperation.grasp_", "control.overdrive.dac_max.grasp2")
    shown = {paths.without_arm(path, ARMS) for path in leaves(console="absolute")}
    shown = {path for path in shown if not path.startswith(idle)}
    # Drawn packets have no length of their own, and the last choice needs shares.
    drawn = {"network.packets"}
    table = pd.concat([at_the_ends(shown - drawn), at_the_ends(drawn, packets=[0.5, 0.5])])
    assert len(table) > 300
    failed = table.loc[table["failed"].astype(str) != "", "group"].tolist()
    assert failed == []
    assert table["peak_model_deviation_mm"].map(lambda x: x < 1e6).all()

"""What is said of a number at its field: said of each, found by the path of its fields, and true
of the robot's own.
"""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign import loading, plan
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import fixed_axis
from ravenjax.numbers import paths
from ravenjax.robots.raven2 import ROBOT

# --- the Raven-II ---


def leaves(**campaign):
    """(path, number, arms) of each parameter of a robot that has every part."""
    config = loading.from_dict(
        {
            "campaign": {"name": "x", "duration_s": 0.01, **campaign},
            "operator": {"motion": "still"},
            "reaction": {},
            "hand": {},
            "detector": [{"name": "model", "kind": "steps", "threshold": [1, 2, 3]}],
            "group": [{"name": "g"}],
        }
    )
    program = plan.make_plan(config).program
    return [
        (path, float(value)) for path, value in paths.path_leaves(program.params, program.setup)
    ]


@pytest.fixture(scope="module")
def every():
    made = [leaves(arms=["gold", "green"]), leaves(software="fork2015"), leaves(console="absolute")]
    return [leaf for one in made for leaf in one]


def test_each_number_has_one_quantity_or_is_reserved(every):
    for path, _ in every:
        assert len(bounds.allowed_values(ROBOT, path)) == (
            0 if bounds.reserved_reason(ROBOT, path) else 1
        ), path


def test_the_robots_own_numbers_lie_within(every):
    for path, value in every:
        for row in bounds.allowed_values(ROBOT, path):
            assert row.low <= value <= row.high and (not row.whole or value == int(value)), path


@given(data=st.data())
def test_a_value_is_refused_just_where_it_leaves_its_range(data):
    path, row = data.draw(st.sampled_from(bounds.parameter_bounds(ROBOT)))
    full = f"{path}.{data.draw(st.sampled_from(row.joints))}" if row.joints else path
    value = data.draw(st.floats(-2.0 * abs(row.low) - 1.0, 2.0 * abs(row.high) + 1.0))
    wrong = not row.low <= value <= row.high or (row.whole and value != int(value))
    allowed = bounds.allowed_values(ROBOT, full)
    assert any(bounds.out_of_range(fixed_axis(value), each) for each in allowed) == wrong

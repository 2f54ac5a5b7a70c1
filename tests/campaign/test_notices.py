"""Values without effect are noted where they stand, and values that act are not."""

import contextlib
from typing import Any

import pytest

import ravenjax as rj
from ravenjax.campaign import notices
from ravenjax.campaign.plan import make_plan
from ravenjax.errors import UserError

FAULT: dict[str, Any] = {
    "site": "usb_out",
    "channel": "shoulder",
    "effect": "offset",
    "value": 14000,
    "start_ms": 1000,
    "duration_ms": 16,
}
SILENT = {"plant.encoder_noise": 0, "plant.torque_noise": 0}
TWICE = {"name": "a", "kind": "steps", "threshold": [1, 1]}
POLICY = {"control.overdrive.policy": 0}
MODE = {"site": "packet_header", "channel": "surgeon_mode", "effect": "overwrite"}
SCALE = {"site": "console", "channel": "scale", "effect": "overwrite"}
OWN_MASS = {"name": "a", "parameters": {"plant.mass_scale": 3}}
MASS = {"site": "parameter", "channel": "plant.gold.mass_scale", "effect": "scale", "value": 2}


def of(fault: dict[str, Any] | None = None, more: tuple = (), **sections: Any) -> str:
    tables = {
        "campaign": {"name": "x", "duration_s": 2.0, **sections.pop("campaign", {})},
        "group": [{"name": "g", "fault": [{**FAULT, **(fault or {})}, *more]}],
    }
    return "\n".join(notices.of_plan(make_plan(rj.load_campaign(tables | sections))))


@pytest.mark.parametrize(
    ("fault", "sections", "said"),
    [
        ({}, {"haptics": {"threshold_mm": [0, 3]}}, "threshold_mm: 0 mm is always exceeded"),
        ({}, {"haptics": {"threshold_mm": 3000}}, "3000 mm is never reached"),
        ({}, {"outcomes": {"limit_mm": 0.003}}, "outcomes.limit_mm: 0.003 mm is always exceeded"),
        ({}, {"outcomes": {"limit_mm": 900}}, "outcomes.limit_mm: 900 mm is never reached"),
        ({}, {"haptics": {"cap": 0}}, "haptics: set 0 has cap 0"),
        ({}, {"reaction": {"felt_force": 1}}, "reaction.felt_force: 1 device units"),
        ({}, {"reaction": {"action": "none", "delay_ms": 300}}, "reaction.delay_ms: has no effect"),
        ({}, {"parameters": {"plant.kinematic_errors.scale": 0.5}}, "has no effect while"),
        ({}, {"parameters": {"plant.friction_scale": 1}}, "this is already the robot's value"),
        ({}, {"limits": {"shoulder_deg": [0.2, 1.2]}}, "write [11.46, 68.75]"),
        ({}, {"operator": {"start": {"wrist_deg": -0.5}}}, "operator.start.wrist_deg: got -0.5"),
        ({}, {"limits": {"shoulder_deg": [60, 80]}}, "shoulder starts outside its range in"),
        ({}, {"campaign": {"observe_ms": 5000}}, "campaign.observe_ms: has no effect"),
        ({}, {"campaign": {"observe_ms": 2}}, "got 2. If this is in seconds, write 2000"),
        ({}, {"haptics": {"threshold_mm": 0.003}}, "model. If this is in metres, write 3"),
        ({}, {"reaction": {"delay_ms": 0.25}}, "any person. If this is in seconds, write 250"),
        ({}, {"campaign": {"limit": 7}}, "campaign.limit: 7 limits nothing"),
        ({}, {"haptics": {"threshold_mm": [2, 3, 2]}}, "haptics: set 2 is the same as set 0"),
        ({}, {"detector": [TWICE]}, "detector[0].threshold: contains a number twice"),
        ({}, {"stop": {"half_width": 0.1, "looks": [1]}}, "stop.looks: the only look is at"),
        ({}, {"campaign": {"noise": True}, "parameters": SILENT}, "has no effect in group 'g'"),
        ({"wraps": True}, {}, "group[0].fault[0].wraps: has no effect"),
        ({"effect": "periodic", "period_ms": 2}, {}, "fault[0].value: changes"),
        ({"value": [0, 9]}, {}, "fault[0].value: changes the signal by at most one count"),
        ({"effect": "scale", "value": 1}, {}, "fault[0].value: changes"),
        ({"site": "torque_scale", "effect": "overwrite", "value": 1}, {}, "fault[0].value: change"),
        ({"site": "encoder", "effect": "drift", "value": 0.01}, {}, "fault[0].value: changes"),
        ({**MODE, "value": 1}, {}, "fault[0].value: changes"),
        ({**MODE, "value": 0, "start_ms": 20}, {}, "fault[0].value: changes"),
        ({**MODE, "channel": "size", "value": 124}, {}, "fault[0].value: changes"),
        ({**SCALE, "value": 0.3}, {"operator": {"scale": 0.3}}, "fault[0].value: changes"),
        ({"site": "jvel"}, {}, "fault[0].site: nothing in the robot reads this"),
        ({"start_ms": 100}, {}, "the fault ends before the robot is in pedal-down"),
        ({"start_ms": {"uniform": [1990, 2900]}}, {}, "the fault does not begin before"),
        ({"start_ms": 1999, "duration_ms": 64}, {}, "up to 63 of 64 ms are after"),
        ({**MASS, "effect": "offset", "value": [-0.5, -2]}, {}, "mass_scale becomes -1, expected"),
        ({**MASS, "effect": "scale", "value": 1e3}, {}, "mass_scale becomes 1000, expected"),
        (MASS, {"parameters": {"plant.mass_scale": 99}}, "plant.gold.mass_scale becomes 198"),
        ({**MASS, "effect": "overwrite", "value": 1}, {}, "fault[0].value: changes the signal"),
        ({**MASS, "value": 1}, {"parameters": {"plant.mass_scale": 2}}, "fault[0].value: changes"),
        ({}, {"reaction": {"delay_ms": 1000}}, "reaction.delay_ms: the delay is so long"),
        ({}, {"reaction": {}, "parameters": {"reaction.felt_force": [0, 1]}}, "1 of 2 runs of gr"),
        ({}, {"reaction": {"slow_to": 0.5}}, "reaction.slow_to: has no effect"),
        (MASS, {"campaign": {"dac_words": "wrap"}}, "campaign.dac_words: has no effect"),
        ({}, {"campaign": {"level": "beginner"}, "parameters": POLICY}, "campaign.level: has no"),
        ({}, {"campaign": {"seed": 3}}, "campaign.seed: has no effect"),
        ({}, {"campaign": {"duration_s": 0.1}, "group": [{"name": "a"}]}, "1 of 1 runs of gr"),
        ({}, {"operator": {"motion": "still", "seed": 3}}, "operator.seed: motion 'still' is the"),
        ({}, {"parameters": {"plant.mass_scale": 2}, "group": [OWN_MASS]}, "no run has this value"),
        ({}, {"detector": [TWICE, {**TWICE, "name": "b"}]}, "detector[1]: differs from"),
        ({"every_ms": 1500}, {}, "fault[0].every_ms: the fault is not repeated"),
        ({"start_ms": 1500, "duration_ms": [500, 600, "end"]}, {}, "group: 2 of 3 runs have"),
        (
            {"trigger": "pedal", "start_ms": 1500, "duration_ms": [200, 300, 400]},
            {},
            "group: 1 of 3 runs have",
        ),
    ],
)  # fmt: skip
def test_what_cannot_act_is_noted(fault, sections, said):
    assert said in of(fault, **sections)


def test_the_same_fault_or_hazard_twice_is_noted():
    assert "fault[1].site: the run has the same fault twice" in of(more=(FAULT,))
    cover = {**FAULT, "effect": "overwrite", "value": 9000, "start_ms": 0, "duration_ms": "end"}
    for later, hides in ((cover, True), ({**cover, "start_ms": 1999}, False)):
        assert ("fault[0].site: has no effect: a later fault" in of(more=(later,))) is hides
    for channel, copies in (("shoulder", False), ("elbow", True)):
        pair = FAULT, {**FAULT, "channel": channel, "value": 9000}
        groups = [{"name": str(k), "fault": faults} for k, faults in enumerate((pair, pair[::-1]))]
        assert ("1 of 2 runs have the same inputs" in of(group=groups)) is copies
    assert "group[0].hazards: C09 is listed twice" in of(
        group=[{"name": "a", "hazards": ["C09", "C09"]}]
    )


def test_notices_of_one_kind_are_one():
    names = ("mass_scale", "friction_scale", "cable_stiffness_scale", "motor_constant_scale")
    paths = (*(f"plant.{name}" for name in names), "nominal.mass_scale")
    said = of(group=[{"name": "a", "parameters": {path: [1, 2] for path in paths}}])
    assert "plant.mass_scale (the robot's value: 1), " in said and " and 1 more: runs" in said
    assert said.count("\n") == 0


def test_windows_that_open_again_are_compared_pair_by_pair():
    pairs = {"name": "a", "design": "zip"}
    for every, fits in (([20, 100], True), ([20, 40], False)):
        fault = {**FAULT, "duration_ms": [10, 50], "every_ms": every}
        with contextlib.nullcontext() if fits else pytest.raises(UserError, match="opens again"):
            of(group=[{**pairs, "fault": [fault]}])
    with pytest.raises(UserError, match="got 20 with duration_ms 50"):
        of({"duration_ms": [10, 50], "every_ms": [20, 100]})


def test_what_acts_is_not_noted():
    assert of() == "" == of(MASS) == of({**MODE, "value": 0}) == of({**SCALE, "value": 0.3})
    assert (
        of({"start_ms": 1000, "duration_ms": "end"}, reaction={}, haptics={"threshold_mm": 2}) == ""
    )


@pytest.mark.parametrize(
    ("fault", "sections", "said"),
    [
        ({}, {"campaign": {"noise": "yes"}}, "campaign.noise: got 'yes', expected true or false"),
        ({}, {"campaign": {"seed": "3"}}, "campaign.seed: got '3', expected a number"),
        ({}, {"campaign": {"contact": 1}}, "campaign.contact: got 1, expected true or false"),
        ({}, {"haptics": {"threshold_mm": ["3"]}}, "got '3', expected a number"),
        ({}, {"operator": {"start": {"elbow_deg": 1.5}}}, "in radians, write 85.94"),
        ({}, {"operator": {"start": {"insertion_m": 400}}}, "in millimetres, write 0.4"),
        ({}, {"campaign": {"duration_s": 5000}}, "in milliseconds, write 5"),
        ({"duration_ms": 0.016}, {}, "in seconds, write 16"),
        ({"start_ms": [0.5, 1.5]}, {}, "in seconds, write [500.0, 1500.0]"),
        ({}, {"parameters": {"plant.friction_scale": True}}, "got True, expected a number"),
        ({"value": {"uniform": [-0.4, 0.4]}}, {}, "whole numbers as limits, such as -1 and 1"),
        ({"value": {"loguniform": [1.2, 1.8]}}, {}, "shoulder is a whole number (cnt)"),
        ({"start_ms": {"uniform": [500.2, 500.6]}}, {}, "limits, such as 500 and 501"),
        ({"duration_ms": {"loguniform": [1.5, 1.5]}}, {}, "limits, such as 1 and 2"),
    ],
)
def test_a_value_of_another_type_is_refused(fault, sections, said):
    with pytest.raises(UserError) as error:
        of(fault, **sections)
    assert said in str(error.value)

"""First and last tick of windows that count packets, or time in pedal-down, by runs of whole
robots.
"""

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.campaign.faults import span

TICKS = 5000

HARMLESS = {"site": "jvel", "channel": "elbow", "effect": "offset", "value": 1.0}
"""Nothing in the loop uses it, and it differs in each tick of its window."""

WINDOWS = [
    {"trigger": trigger, "start_ms": start, "duration_ms": duration, "every_ms": every}
    for trigger in ("packet", "pedal")
    for start, duration, every in [
        (0, 1, 0),
        (0, 5, 0),
        (1, 1, 0),
        (300, 40, 0),
        (90, 20, 130),
        (1650, 30, 0),
    ]
] + [{"trigger": "pedal", "start_ms": 100, "duration_ms": "end"}]


def windows_of(campaign=None, motion="clutched", **sections):
    """The plan of runs with these windows, and the tick in which each was first and last open."""
    raw = {
        "campaign": {"name": "windows", "duration_s": TICKS / 1000, **(campaign or {})},
        "operator": {"motion": motion},
        "group": [
            {"name": "g", "design": "list", "fault": [{**HARMLESS, **WINDOWS[0]}], "run": []}
        ],
        **sections,
    }
    raw["group"][0]["run"] = [{"fault": [window]} for window in WINDOWS]
    config = rj.load_campaign(raw)
    ready, table = plan.make_plan(config), rj.run(config, engine="simd")
    return ready, table["applied0_first_ms"].to_numpy(), table["applied0_last_ms"].to_numpy()


def ends_of(ready, observe=1):
    return span.observation_ends(ready.faults, TICKS, observe, ready.clocks)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        pytest.param({}, id="clutched"),
        pytest.param(
            {"motion": "suture", "parameters": {"network.cycles_per_packet": 3}},
            id="three cycles a packet",
        ),
        pytest.param({"campaign": {"software": "fork2015"}}, id="no PLC"),
        pytest.param(
            {
                "campaign": {"software": "fork2015"},
                "parameters": {"control.state_machine.plc_obeyed": 1},
            },
            id="PLC",
        ),
    ],
)
def test_ends_of_windows_are_known_to_the_tick(case):
    ready, first, last = windows_of(**case)
    opens = first >= 0
    assert opens.any() and (ready.acts[opens] <= first[opens]).all()
    np.testing.assert_array_equal(
        ends_of(ready), np.where(opens, np.minimum(last + 2, TICKS), TICKS)
    )


@pytest.mark.slow
@pytest.mark.parametrize("packets", ["measured", "bursts"])
def test_windows_of_packets_that_are_drawn_are_bounded(packets):
    ready, first, last = windows_of({"packets": packets})
    opens = first >= 0
    assert opens.any() and (ready.acts[opens] <= first[opens]).all()
    ends, counts = ends_of(ready), np.array([window["trigger"] == "packet" for window in WINDOWS])
    longest = ready.config.longest_packet
    assert (ends[opens] >= np.minimum(last[opens] + 2, TICKS)).all()
    np.testing.assert_array_equal(
        ends[counts], np.where(opens, np.minimum(last + 2, TICKS), TICKS)[counts]
    )
    once = ~counts & opens & np.array([not window.get("every_ms") for window in WINDOWS])
    assert (ends[once] < last[once] + 2 + longest).all(), (
        "the pedal of such a run by a packet at most"
    )


@pytest.mark.slow
def test_an_operator_who_slows_down_moves_the_pedal():
    reaction = {"action": "slow", "delay_ms": 0}
    haptics = {"threshold_mm": 0.001}
    ready, first, _ = windows_of(reaction=reaction, haptics=haptics)
    opens = first >= 0
    assert (ready.acts[opens] <= first[opens]).all()
    counts = np.array([window["trigger"] == "pedal" for window in WINDOWS])
    assert (ends_of(ready)[counts] == TICKS).all()


def test_a_fault_that_may_move_the_pedal_leaves_its_end_unknown():
    steering = {"site": "plc", "channel": "runlevel", "effect": "overwrite", "value": 2}
    for site, unknown in ((steering, True), (HARMLESS, False)):
        window = {"trigger": "pedal", "start_ms": 300, "duration_ms": 40}
        other = {**site, "start_ms": 400, "duration_ms": 1}
        raw = {
            "campaign": {"name": "moved", "duration_s": 2.0, "observe_ms": 3},
            "group": [{"name": "g", "fault": [{**HARMLESS, **window}, other]}],
        }
        assert (plan.make_plan(rj.load_campaign(raw)).ends[0] == 2000) == unknown

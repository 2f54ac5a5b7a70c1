"""One run in words, by hand: every event at its time, with its unit, in the order of the loop."""

from __future__ import annotations

import numpy as np

from ravenjax.outcomes.events import Rules
from ravenjax.report.run.summary import list_events

TICKS = 3000
RULES = Rules(cue=0, threshold_mm=3.0, limit_mm=3.0)
ROW = {
    "run_id": "0123456789abcdef",
    "index": 17,
    "group": "dac",
    "failed": "",
    "fault0_site": "usb_out",
    "fault0_arm": "gold",
    "fault0_channel": "shoulder",
    "fault0_effect": "overwrite",
    "fault0_value": 12000.0,
    "fault0_trigger": "time",
    "fault0_start_ms": 1200,
    "fault0_duration_ms": 16,
    "fault0_every_ms": 0,
    "fault0_period_ms": 0,
    "fault1_site": "",
    "fault1_arm": "",
    "fault1_channel": "",
    "fault1_effect": "",
    "fault1_value": float("nan"),
    "fault1_trigger": "",
    "fault1_start_ms": 0,
    "fault1_duration_ms": 0,
    "fault1_every_ms": 0,
    "fault1_period_ms": 0,
    "applied0_first_ms": 1200,
    "applied0_last_ms": 1215,
    "applied0_ticks": 16,
    "applied1_first_ms": -1,
    "applied1_last_ms": -1,
    "applied1_ticks": 0,
    "check_overdrive_clip_first_ms": 1201,
    "check_overdrive_clip_count": 9,
    "check_ik_reject_first_ms": 1400,
    "check_ik_reject_count": 1,
    "check_packet_skip_first_ms": 0,
    "check_packet_skip_count": 1,
    "check_estop_first_ms": -1,
    "check_estop_count": 0,
    "cue0_first_ms": 1230,
    "golden_cue0_first_ms": -1,
    "cue0_peak_force": 0.0312,
    "cue0_ms": 170,
    "unintended_mm": 12.345,
    "unintended_first_ms": 1228,
    "unintended_off_mm": 0.0,
    "loss_mm": 0.0,
    "loss_first_ms": -1,
    "false_report_mm": 4.5,
    "false_report_first_ms": 1500,
    "halted_ms": 0,
    "golden_halted_ms": 0,
    "reaction_ms": 1500,
    "jump_code": True,
    "jump_code_first_ms": 1201,
    "tissue_depth_mm": 2.25,
    "golden_tissue_depth_mm": 0.5,
    "peak_model_deviation_mm": 12.5,
    "response": "flagged",
    "response_cause": "ik_reject",
    "response_ms": 1400,
    "hazard": "unintended motion",
    "verdict": "flagged/unintended motion/cue",
}
GOLDEN = {"check_overdrive_clip_count": 4, "check_ik_reject_count": 0, "check_packet_skip_count": 1}
GOLDEN |= {"check_estop_count": 0}


def series():
    runlevel = np.full(TICKS, 2)
    runlevel[204:] = 3
    force = np.zeros((TICKS, 2))
    force[1230:1400, 0], force[2000:, 0] = 0.0312, 0.01
    tip = np.zeros((TICKS, 3))
    tip[1300] = 0.012345, 0, 0
    return {
        "runlevel": runlevel,
        "soft_estopped": np.zeros(TICKS, int),
        "brakes": (np.arange(TICKS) < 200).astype(int),
        "fault0_active": (np.arange(TICKS) >= 1200) & (np.arange(TICKS) < 1216),
        "gold/cue_force": force,
        "gold/tip_error_mm": np.linspace(0, 9, TICKS),
        "gold/tip": tip,
        "gold/model_position": np.zeros((TICKS, 3)),
        "gold/golden_tip": np.zeros((TICKS, 3)),
    }


def test_a_run_is_told_in_the_order_of_the_loop():
    found = list_events(ROW, RULES, series(), GOLDEN)
    assert [(event.ms, event.kind) for event in found] == [
        (0, "check"),
        (200, "brakes"),
        (204, "run level"),
        (1200, "fault"),
        (1200, "fault"),
        (1201, "check"),
        (1201, "jump"),
        (1215, "fault"),
        (1228, "hazard"),
        (1230, "cue"),
        (1400, "check"),
        (1500, "hazard"),
        (1500, "operator"),
        (2000, "cue"),
    ]
    texts = "\n".join(event.text for event in found)
    for part in (
        "usb_out gold shoulder, overwrite 12,000 counts, 16 ms from 1,200 ms",
        "9 ms, 4 of them also in the golden run; it limits without an alarm",
        "would have left it (up to 12.3 mm)",
        "on for 170 ms, at most 0.0312 device units: the reported gold tip is 3.69 mm from",
    ):
        assert part in texts
    assert [event.level for event in found if event.kind in ("check", "hazard")] == [
        *("debug", "warn", "error", "warn", "error")
    ]

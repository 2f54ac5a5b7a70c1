"""Checks with a file of one's own: bits of built-in ones, what they do at each seam, columns,
identity, and errors.
"""

import copy
from pathlib import Path

import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines
from tiny_campaign import fault

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.errors import UserError
from ravenjax.outcomes import verdict
from ravenjax.robots.raven2 import ROBOT
from ravenjax.vocabulary import checks

HEAD = (
    "from ravenjax.parts import Annotated, Quantity, Scalar, Vec, as_int, jnp, record, to_int32\n"
)
LARGEST = """
def step(params, state, view):
    score = 0
    for command in view.{name}[:6]:
        score = jnp.maximum(score, jnp.abs(command))
    return state, score
"""
CLIP = """
LIMITS = {limits}

def step(params, state, view):
    score, values = 0.0, []
    for command, limit in zip(view.current_cmd[:6], LIMITS):
        over = (jnp.abs(command) > limit) & (view.runlevel >= 1)
        score = jnp.where(over, 2.0, score)
        values.append(jnp.where(over, jnp.where(command > 0, limit, -limit), command))
    return state, score, Vec((*values, view.current_cmd[6]))
"""
BOARDS = """
@record
class Most:
    counts: Annotated[Scalar, Quantity("DAC counts", 1, 65535, "step at which the score is 1")]

def params():
    return Most(6000.0)

def step(params, state, view):
    score = 0.0
    for now, before in zip(view.boards_cmd[:3], view.held_cmd):
        score = jnp.maximum(score, jnp.abs(now - before) / params.counts)
    return state, score{more}
"""
FAULT = fault("usb_out", "elbow", "overwrite", [200, 14000], 700)
EARLY = fault("current_cmd", "elbow", "offset", [6000, 22000], 700)


def tables(
    folder: Path, text: str, fault: dict = FAULT, campaign: dict | None = None, **check
) -> dict:
    """A fault-free run and two that are struck, with a check of one's own, if it says where it
    stands.
    """
    path = folder / "mine.py"
    path.write_text(HEAD + text)
    own = {"name": "mine", "file": str(path), **check}
    return {
        "campaign": {"name": "x", "duration_s": 1.0, **(campaign or {})},
        **({"check": [own]} if "at" in check else {}),
        "group": [
            {"name": "free"},
            {"name": "hit", "fault": [{**copy.deepcopy(fault), "duration_ms": 64}]},
        ],
    }


def limits() -> list[int]:
    ready = plan.make_plan(
        rj.load_campaign({"campaign": {"name": "x"}, "group": [{"name": "free"}]})
    )
    return [int(limit) for limit in ready.program.params.control.overdrive.dac_max][:6]


def require_equal(one, other, names) -> None:
    for name in names:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_the_text_of_a_built_in_check_gives_its_history(tmp_path):
    text = LARGEST.format(name="current_cmd")
    raw = tables(tmp_path, text, EARLY, at="current_cmd", threshold=20000)
    table = rj.run(raw, engine="simd")
    assert table["check_overdrive_instant_count"].max() > 0
    for what in ("first_ms", "count", "margin"):
        own, built_in = table[f"check_own_mine_{what}"], table[f"check_overdrive_instant_{what}"]
        np.testing.assert_array_equal(own, built_in, err_msg=what)


def test_the_text_of_the_built_in_clip_gives_its_motion_to_the_bit(tmp_path):
    text, own = CLIP.format(limits=limits()), {"at": "current_cmd", "acts": "limit"}
    clipped = rj.run(tables(tmp_path, text, EARLY), engine="simd")
    limited = rj.run(
        tables(tmp_path, text, EARLY, {"policy": "no_regulation"}, **own), engine="simd"
    )
    free = rj.run(tables(tmp_path, text, EARLY, {"policy": "no_regulation"}), engine="simd")
    assert clipped["check_overdrive_clip_count"].max() > 0
    assert (free["peak_model_deviation_mm"] != clipped["peak_model_deviation_mm"]).any()
    names = ("run_id", "response", "verdict", "told_ms", "built_in", "check_overdrive", "peak_dac")
    same = [name for name in clipped.columns if not name.startswith(names)]
    # The third run goes beyond the instant limit.
    require_equal(limited.iloc[:2], clipped.iloc[:2], same)
    np.testing.assert_array_equal(
        limited["check_own_mine_count"][:2], clipped["check_overdrive_clip_count"][:2]
    )
    np.testing.assert_array_equal(limited["response"][:2], clipped["response"][:2])


def test_a_stop_in_the_software_raises_its_e_stop_as_the_overdrive_check_does(tmp_path):
    """In the same millisecond, from where the watchdog's wave and the PLC stop the robot at the
    same ticks.
    """
    built_in = rj.run(tables(tmp_path, "", EARLY), engine="simd").iloc[2]
    raw = tables(
        tmp_path,
        LARGEST.format(name="current_cmd"),
        EARLY,
        at="current_cmd",
        acts="stop",
        threshold=20000,
    )
    own = rj.run(
        raw | {"parameters": {"control.overdrive.max_inst_dac": 32768}}, engine="simd"
    ).iloc[2]
    assert built_in["response_cause"] == "overdrive" and own["response_cause"] == "own_mine"
    assert own["check_overdrive_instant_count"] == 0 and own["built_in_response"] in (
        "limited",
        "silent",
    )
    names = ["response", "response_ms", "told_ms", "end_runlevel", "pedal_down_ms"]
    names += [f"check_{one}_first_ms" for one in ("soft_estop", "plc_watchdog", "estop")]
    assert own[names].to_dict() == built_in[names].to_dict() and own["check_estop_first_ms"] > 0


def test_a_board_that_refuses_holds_zero_and_lets_the_plc_stop_the_robot(tmp_path):
    table = rj.run(
        tables(tmp_path, BOARDS.format(more=""), at="usb_out", acts="stop"), engine="simd"
    )
    free, mild, hard = (table.iloc[row] for row in range(3))
    assert free["response"] == "silent" and free["check_own_mine_first_ms"] == -1
    assert mild["check_own_mine_count"] == 0 and mild["check_own_mine_margin"] > 0
    assert hard["check_own_mine_first_ms"] == 700 and hard["check_own_mine_margin"] < 0
    assert (hard["response"], hard["response_cause"], hard["built_in_response"]) == (
        "stopped",
        "own_mine",
        "silent",
    )
    assert hard["check_soft_estop_count"] == 0  # the software knows nothing of it
    # Since the last edge of the wave.
    assert 700 + 75 - 26 <= hard["check_plc_watchdog_first_ms"] <= 700 + 76
    assert (
        hard["check_plc_watchdog_first_ms"]
        < hard["check_estop_first_ms"]
        <= hard["check_plc_watchdog_first_ms"] + 4
    )


def test_a_board_that_limits_holds_what_it_held(tmp_path):
    """As if the write had failed: the struck command never arrives."""
    text = BOARDS.format(more=", view.held_cmd")
    table = rj.run(tables(tmp_path, text, at="usb_out", acts="limit"), engine="simd")
    plain = rj.run(tables(tmp_path, text), engine="simd")
    hard, unhindered = table.iloc[2], plain.iloc[2]
    assert hard["check_own_mine_count"] == 64 and hard["response"] == "limited"
    assert hard["unintended_mm"] < 0.5 * unhindered["unintended_mm"]
    names = [name for name in plain.columns if not name.startswith(("run_id", "built_in"))]
    require_equal(table.iloc[:2], plain.iloc[:2], names)


def test_built_in_ones_count_until_the_first_of_ones_own_acts():
    """A limit of one's own at 600 ms changes the course, though its stop at 900 ms is stronger."""
    own = (checks.of_own("little", "jpos", "limit"), checks.of_own("late", "jpos", "stop"))
    robot = ROBOT.with_checks(own)
    names = ("own_little", "own_late", "overdrive_instant")
    outcomes = {"first_active_ms": np.array([500, 500, 500])}
    firsts = [600, 600, -1], [900, 900, 900], [700, 550, 700]
    for name, first in zip(names, map(np.array, firsts), strict=True):
        outcomes |= {
            f"check_{name}_first_ms": first,
            f"check_{name}_count": (first >= 0).astype(int),
        }
    golden = {f"check_{name}_count": np.zeros(3, int) for name in names}
    golden |= {f"check_{name}_first_ms": np.full(3, -1) for name in names}
    responses = verdict.built_in_responses(outcomes, golden, robot).response
    assert [verdict.RESPONSES[k] for k in responses] == ["silent", "stopped", "stopped"]


@pytest.mark.parametrize("acts", ["watch", "flag"])
def test_one_that_watches_or_flags_changes_no_motion(tmp_path, acts):
    raw = tables(tmp_path, BOARDS.format(more=""), at="usb_out", acts=acts)
    watched, plain = rj.run(raw, engine="simd"), rj.run(tables(tmp_path, ""), engine="simd")
    counted = ("run_id", "response", "told_ms", "verdict") if acts == "flag" else ()
    require_equal(
        watched, plain, [name for name in plain.columns if not name.startswith(counted or "none")]
    )
    assert (plain["told_ms"][2], watched["told_ms"][2]) == (733, 700 if acts == "flag" else 733)
    assert ("built_in_response" in watched) == (acts == "flag")


STEP = "def step(params, state, view):\n    return "
WRONG = {
    "seam": (
        {"at": "usb"},
        STEP + "state, 1.0",
        r"unknown seam 'usb', expected one of packet, .*usb_out",
    ),
    "changed": ({"at": "jpos", "sha256": "0" * 64}, STEP + "state, 1.0", r"has changed since"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_by_one_error(tmp_path, case):
    own, text, said = WRONG[case]
    with pytest.raises(UserError, match=said):
        rj.run(tables(tmp_path, text, **own), engine="simd")


@pytest.mark.slow
@pytest.mark.parametrize("acts", ["stop", "limit"])
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path, acts):
    real_or_pretended(monkeypatch, tmp_path)
    text = BOARDS.format(more=", view.held_cmd" if acts == "limit" else "")
    check_engines(
        plan.make_plan(loading.from_dict(tables(tmp_path, text, at="usb_out", acts=acts))), 3
    )

"""Detectors with a file of their own: bits of a built-in one, parameters, identity, and one that
stops the robot.
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
from ravenjax.campaign.inspection import verification
from ravenjax.errors import StoreError, UserError
from ravenjax.outcomes import events

TWINS = """
from ravenjax.parts import Annotated, Quantity, Scalar, Vec, jnp, record

LIMITS = {limits}

def step(params, state, view):
    shares = [jnp.float32(jnp.abs(c)) / jnp.float32(limit) for c, limit in zip(view.current_cmd[:6], LIMITS)]
    score = shares[0]
    for share in shares[1:]:
        score = jnp.maximum(score, share)
    return state, score
"""  # noqa: E501
ERROR = "def step(params, state, view):\n    return state, view.tip_error * 1e3\n"
BOARDS = """
from ravenjax.parts import Annotated, Quantity, Scalar, Vec, jnp, record

@record
class Most:
    counts: Annotated[Scalar, Quantity("DAC counts", 1, 65535, "command at which the score is 1")]

@record
class Last:
    command: Vec

def params():
    return Most(6000.0)

def init(params):
    return Last(Vec.full(3, 0))

def step(params, state, view):
    score = 0.0
    for now, before in zip(view.boards_cmd[:3], state.command):
        score = jnp.maximum(score, jnp.float32(jnp.abs(now - before)) / params.counts)
    return Last(Vec(view.boards_cmd[:3])), score
"""
FAULT = fault("usb_out", "elbow", "overwrite", [200, 14000], 700)


def tables(folder: Path, text: str, *detectors: dict, **campaign) -> dict:
    """Two overwritten commands behind every check and a fault-free run, under a detector of
    one's own and others.
    """
    path = folder / "mine.py"
    path.write_text(text)
    own = {"name": "mine", "file": str(path), "threshold": [0.5, 1.0]}
    return {
        "campaign": {"name": "x", "duration_s": 1.0, **campaign},
        "detector": [own, *detectors],
        "group": [
            {"name": "free"},
            {"name": "hit", "fault": [{**copy.deepcopy(FAULT), "duration_ms": 64}]},
        ],
    }


def limits() -> list[int]:
    ready = plan.make_plan(
        rj.load_campaign({"campaign": {"name": "x"}, "group": [{"name": "free"}]})
    )
    return [int(limit) for limit in ready.program.params.control.overdrive.dac_max][:6]


@pytest.mark.parametrize("kind", ["overdrive", "tip_error"])
def test_the_text_of_a_built_in_detector_gives_its_bits(tmp_path, kind):
    text = TWINS.format(limits=limits()) if kind == "overdrive" else ERROR
    built_in = {"name": "built-in", "kind": kind, "threshold": [0.5, 1.0]}
    table = rj.run(tables(tmp_path, text, built_in), engine="simd")
    names = [name for name in table.columns if name.startswith("detector0_")]
    assert table["detector0_score"].max() > 0.5 and len(names) == 5
    for name in names:
        np.testing.assert_array_equal(
            table[name], table[name.replace("detector0", "detector1")], err_msg=name
        )


@pytest.mark.parametrize(
    "wrong, said",
    [
        ({"kind": "overdrive"}, "expected one key: kind .* or file .*, got both"),
        ({"name": "my-check"}, "expected only letters, digits and _"),
        ({"fusion": "any"}, "needs kind 'steps', got kind 'file'"),
    ],
)
def test_sections_that_do_not_fit_are_refused(tmp_path, wrong, said):
    raw = tables(tmp_path, BOARDS)
    raw["detector"][0] = {
        key: value for key, value in (raw["detector"][0] | wrong).items() if value is not None
    }
    with pytest.raises(UserError, match=said):
        rj.load_campaign(raw)


def test_its_code_is_part_of_what_a_folder_holds(tmp_path):
    campaign = tmp_path / "x.toml"
    (tmp_path / "mine.py").write_text(BOARDS)
    own = '[[detector]]\nname = "mine"\nfile = "mine.py"'
    campaign.write_text(f'[campaign]\nname = "x"\nduration_s = 0.2\n{own}\n[[group]]\nname = "a"\n')
    rj.run(loading.load_campaign(campaign), out=tmp_path / "out", engine="simd")
    (tmp_path / "mine.py").write_text(BOARDS.replace("6000.0", "7000.0"))
    with pytest.raises(StoreError, match=r"config\.detector\[0\]\.sha256"):
        rj.run(loading.load_campaign(campaign), out=tmp_path / "out", engine="simd")
    verified = verification.verify_folder(tmp_path / "out", 1)
    assert not verified.fine and "has changed since" in verified.checks[-1].problems[0]


@pytest.mark.parametrize("engine", ["simd", pytest.param("xla", marks=pytest.mark.slow)])
def test_one_that_stops_presses_the_button_a_millisecond_later(tmp_path, engine):
    raw = tables(tmp_path, BOARDS)
    raw["detector"][0] |= {"acts": "stop", "threshold": [1.0]}
    button = {
        "site": "buttons",
        "channel": "estop",
        "effect": "overwrite",
        "value": 1,
        "duration_ms": "end",
    }
    raw["group"].append({"name": "pressed", "fault": [button | {"start_ms": 701}]})
    table = rj.run(raw, engine=engine)
    free, mild, hard, pressed = (table.iloc[row] for row in range(4))
    assert free["response"] == "silent" and free["detector0_threshold0_first_ms"] == -1
    assert mild["check_estop_count"] == 0
    assert hard["detector0_threshold0_first_ms"] == 700 and hard["response"] == "stopped"
    assert hard["check_estop_first_ms"] == pressed["check_estop_first_ms"] > 700


def test_what_its_stop_makes_the_robot_do_is_no_response_of_the_built_in_checks(tmp_path):
    """Where its stop came late, what evades the built-in checks is what does so without the
    detector.
    """
    raw = tables(tmp_path, ERROR)
    raw["group"][1]["fault"][0]["value"] = [200, 9000]
    raw["detector"][0] |= {"acts": "stop", "threshold": [4.0]}
    config = loading.from_dict(copy.deepcopy(raw))
    stopping, plain = (
        rj.run(config, engine="simd"),
        rj.run(_watching_and_stopping(raw)[0], engine="simd"),
    )
    hit, alone = stopping.iloc[2], plain.iloc[2]
    assert (
        hit["response"] == "stopped" and hit["told_ms"] > hit["detector0_threshold0_first_ms"] > 700
    )
    assert (
        alone["told_ms"] > hit["detector0_threshold0_first_ms"] and "built_in_response" not in plain
    )
    assert hit["built_in_response"] in ("limited", "silent") and hit["built_in_told_ms"] == -1
    assert config.rules.built_in == "built_in_response"
    import pyarrow as pa

    _, built_in, unintended = events.events_happened(
        pa.Table.from_pandas(stopping), ["evades_built_in", "unintended_motion"], config.rules
    )
    assert built_in[2] and unintended[2]


@pytest.mark.slow
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path):
    real_or_pretended(monkeypatch, tmp_path)
    raw = tables(tmp_path, BOARDS, duration_s=0.75)
    raw["detector"][0] |= {"acts": "stop", "threshold": [1.0]}
    check_engines(plan.make_plan(loading.from_dict(raw)), 3)


def _watching_and_stopping(raw: dict) -> list[dict]:
    stopping = copy.deepcopy(raw)
    stopping["detector"][0]["acts"] = "stop"
    return [{key: value for key, value in raw.items() if key != "detector"}, raw, stopping]

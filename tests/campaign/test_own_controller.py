"""Stages of the control software that are files of one's own: bits of the built-in law,
identity, sweeps, errors.
"""

from pathlib import Path

import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines
from tiny_campaign import fault

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.errors import UserError

HEAD = "from ravenjax.parts import Annotated, Quantity, Scalar, Vec, jnp, record, to_int32, where\n"
PID = """
@record
class Memory:
    integral: Vec  # 7 rad s

def init(params):
    return Memory(Vec.full(7, 0.0))

def step(params, state, view):
    error = view.mpos_d - view.mpos
    integral = where(view.pedal_down, state.integral + error * view.period, state.integral)
    law = view.kp * error + view.kd * (view.mvel_d - view.mvel) + view.ki * integral
    tau = law.map(lambda t: jnp.where(view.pedal_down, t, 0.0))
    return Memory(integral), Vec((*(Vec(tau[:3]) + view.tau_g), *tau[3:]))
"""
DAC = """
def step(params, state, view):
    return state, Vec(
        to_int32(t * amps * counts) for t, amps, counts in zip(view.tau_d, view.amps_per_torque, view.counts_per_amp)
    )
"""  # noqa: E501
WEAK = """
@record
class Share:
    share: Annotated[Scalar, Quantity("", 0, 1, "of the current")]

def params():
    return Share(1.0)

def step(params, state, view):
    return state, Vec(
        to_int32(params.share * t * a * c) for t, a, c in zip(view.tau_d, view.amps_per_torque, view.counts_per_amp)
    )
"""  # noqa: E501
FAULT = fault("tau_d", "elbow", "offset", [0.05, 0.4], 500)


def tables(folder: Path, arms: tuple[str, ...] = ("gold", "green"), **stages: str) -> dict:
    """A fault-free run and two whose last arm is struck, with these texts in place of stages."""
    files = {}
    for stage, text in stages.items():
        files[stage] = str(folder / f"{stage}.py")
        Path(files[stage]).write_text(HEAD + text)
    return {
        "campaign": {"name": "x", "duration_s": 0.7, "arms": list(arms)},
        **({"controller": files} if files else {}),
        "group": [
            {"name": "free"},
            {"name": "hit", "fault": [{**FAULT, "arm": arms[-1], "duration_ms": 64}]},
        ],
    }


@pytest.mark.parametrize(
    "engine, arms",
    [("simd", ("gold", "green")), pytest.param("xla", ("gold",), marks=pytest.mark.slow)],
)
def test_the_text_of_the_built_in_laws_gives_their_bits(tmp_path, engine, arms):
    own = rj.run(tables(tmp_path, arms, motor_control=PID, dac=DAC), engine=engine)
    built_in = rj.run(tables(tmp_path, arms), engine=engine)
    assert list(own.columns) == list(built_in.columns) and not set(own["run_id"]) & set(
        built_in["run_id"]
    )
    for name in own.columns:
        if name != "run_id":
            np.testing.assert_array_equal(own[name], built_in[name], err_msg=name)


@pytest.mark.slow
def test_its_parameters_are_swept_and_matter(tmp_path):
    raw = tables(tmp_path, dac=WEAK)
    raw["group"][1]["cross"] = {"control.own.dac.share": [0.5, 1]}
    table = rj.run(raw, engine="simd")
    paths = table.groupby("param:control.own.dac.share")["golden_tip_path_mm"].max()
    assert 0 < paths[0.5] < 0.9 * paths[1.0]
    assert paths[1.0] == rj.run(tables(tmp_path), engine="simd")["golden_tip_path_mm"].max()


STEP = "def step(params, state, view):\n    return "
WRONG = {
    "array": (STEP + "state, jnp.ones(7)", r"returns .* for current_cmd, expected .* of 7 numbers"),
    "kind": (
        STEP + "state, view.tau_d",
        r"returns a float for current_cmd\[0\], expected int: write to_int32",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_by_one_error(tmp_path, case):
    text, said = WRONG[case]
    with pytest.raises(UserError, match=said):
        rj.run(tables(tmp_path, dac=text), engine="simd")


@pytest.mark.parametrize(
    "section, said",
    [
        ({}, "replaces no stage: write motor_control or dac"),
        ({"dac": "none.py"}, "file of stage 'dac' cannot be read"),
    ],
)
def test_sections_that_do_not_fit_are_refused(tmp_path, section, said):
    with pytest.raises(UserError, match=said):
        plan.make_plan(rj.load_campaign(tables(tmp_path) | {"controller": section}))


@pytest.mark.slow
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path):
    real_or_pretended(monkeypatch, tmp_path)
    check_engines(
        plan.make_plan(loading.from_dict(tables(tmp_path, motor_control=PID, dac=DAC))), 3
    )

"""Schema: names once, types kept, misfits refused by name."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import synthetic_results as synthetic

from ravenjax.robots.raven2.declaration import CHECKS
from ravenjax.store import schema
from ravenjax.vocabulary import checks

SHAPE = synthetic.shape()


@pytest.mark.parametrize("form", [SHAPE, schema.Shape(arms=("gold", "green"), slots=3, cues=2)])
def test_each_column_is_named_once_and_described(form):
    columns = schema.columns(form)
    names = [c.name for c in columns]
    assert len(set(names)) == len(names)
    assert all(c.meaning for c in columns)
    assert all(
        c.unit for c in columns if c.dtype.startswith(("float", "int")) and c.name not in UNITLESS
    ), "unit missing"


UNITLESS = {"index", "pair", "seed", "end_runlevel"} | {f"cue{k}_count" for k in range(9)}
UNITLESS |= {f"detector{d}_threshold{k}_alarms" for d in range(9) for k in range(9)}


def test_results_readme_describes_each_column():
    text = (Path(__file__).resolve().parents[2] / "results" / "README.md").read_text(
        encoding="utf-8"
    )
    names = {
        "arms": ("<arm>",),
        "joints": ("<joint>",),
        "checks": ("<check>",),
        "parameters": ("<path>",),
    }
    own = (checks.of_own("mine", "usb_out", "stop"),)
    form = schema.Shape(
        **names,
        reacts=True,
        hand_yields=True,
        cables=True,
        detectors=(1,),
        observes=True,
        own_checks=own,
    )
    for column in schema.columns(form):
        name = re.sub("(fault|cue|applied|threshold)0", r"\1<k>", column.name).replace(
            "detector0", "detector<d>"
        )
        if name.startswith(schema.GOLDEN):
            assert f"`{name.removeprefix(schema.GOLDEN)}`" in text.partition("`golden_<column>`")[2]
        else:
            assert f"| `{name}` | {column.dtype} |" in text
    for check, unit, what, action, *_ in CHECKS.values():
        assert f"| `{check}` | {unit} | {what} | {action} |" in text
    assert f"schema version {schema.VERSION} " in text


@pytest.mark.slow
def test_reading_results_needs_no_jax():
    code = (
        "import sys, ravenjax.report.page, ravenjax.report.run.plot; sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

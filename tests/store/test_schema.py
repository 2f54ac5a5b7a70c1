"""Schema: names once, types kept, misfits refused by name."""

import re
from pathlib import Path

from ravenjax.robots.raven2.declaration import CHECKS
from ravenjax.robots.raven2.loop.optional import STAGES
from ravenjax.store import schema
from ravenjax.vocabulary import checks

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
        **names, stages=tuple(STAGES), detectors=(1,), observes=True, own_checks=own
    )
    for column in schema.table_columns(form):
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

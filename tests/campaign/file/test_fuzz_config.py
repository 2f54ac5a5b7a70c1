"""Campaigns with anything wrong anywhere: loading gives a campaign or a UserError, never another
exception.
"""

import re

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ravenjax.campaign import loading
from ravenjax.errors import UserError

RELAXED = settings(max_examples=120, deadline=None, suppress_health_check=list(HealthCheck))


TEXT = """
[campaign]
name = "text"
duration_s = 4.0
seed = 3
arms = ["gold", "green"]

[operator]
motion = "suture"
scale = 0.1

[parameters]
plant.friction_scale = { uniform = [0.5, 2.0] }

[cross]
reaction.action = [0, 1]

[limits]
elbow_deg = [50, 120]

[haptics]
threshold_mm = [3, 2]
combine = "grid"

[reaction]
action = "slow"
delay_ms = 200

[[detector]]
name = "model"
kind = "steps"
fusion = ["all", "any"]
threshold = [0.5, 1]

[outcomes]
jump = "text"
cue = 1

[stop]
half_width = 0.05
rates = ["evades", "cue"]
looks = [0.1, 1.0]
allocation = "neyman"

[[group]]
name = "drawn"
design = "sobol"
runs = 16
[[group.fault]]
site = "usb_out"
arm = "gold"
channel = ["shoulder", "elbow"]
effect = ["overwrite", "latch_offset"]
value = { uniform = [-200, 200] }
start_ms = [10, 20]
duration_ms = [5, "end"]

[[group]]
name = "library"
hazards = ["C09", "L7"]
arm = "gold"
start_ms = 100
"""
WRITTEN = [number for number, line in enumerate(TEXT.splitlines()) if " = " in line]
WRONG = (
    "-1",
    "1e9",
    '"nonsense"',
    "[]",
    "[1, 2, 3]",
    '["x"]',
    "{ x = 1 }",
    "{ uniform = [2, 1] }",
    "true",
    '""',
    "nan",
)
SAYS = (
    "expected",
    "exactly one of",
    "missing",
    "unknown key",
    "remove",
    "write",
    "belongs to",
    "needs",
    "give",
    "got",
)
"""Each complaint has at least one of these words: it says what was got, or what to write
instead.
"""


@settings(RELAXED, max_examples=100)
@given(st.sampled_from(WRITTEN), st.sampled_from(WRONG))
@example(WRITTEN[-1], "[]")
def test_a_wrong_value_is_located(tmp_path_factory, number, wrong):
    """One value of a file replaced: a campaign, or complaints that name file, line and key and
    what was expected.
    """
    rows = TEXT.splitlines()
    key = rows[number].partition(" = ")[0]
    rows[number] = f"{key} = {wrong}"
    path = tmp_path_factory.mktemp("c", numbered=True) / "c.toml"
    path.write_text("\n".join(rows))
    try:
        loading.load_campaign(path)
    except UserError as error:
        for complaint in str(error).splitlines():
            assert complaint.startswith(f"{path}:") and any(word in complaint for word in SAYS), (
                complaint
            )
            line, named, _ = complaint.removeprefix(f"{path}:").split(": ", 2)
            there = rows[int(line) - 1]
            last = re.sub(r"\[\d+\]", "", named).rpartition(".")[2]
            # Of a key that is missing, the table.
            assert there.startswith("[") or last in there, complaint

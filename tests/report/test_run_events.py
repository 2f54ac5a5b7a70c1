"""Events of a run are those of its row, each at its time, in order."""

import numpy as np
import synthetic_results as synthetic

from ravenjax.outcomes.events import Rules
from ravenjax.report.run.summary import list_events

TICKS = 3000


def test_events_of_a_run_come_at_the_times_of_its_row():
    runlevel, brakes = np.full(TICKS, 2), (np.arange(TICKS) < 200).astype(int)
    runlevel[204:] = 3
    for row in synthetic.frame(300).to_dict("records"):
        series = {"runlevel": runlevel, "brakes": brakes, "soft_estopped": 0 * brakes}
        found = list_events(row, Rules(), series)
        assert [event.tick for event in found] == sorted(event.tick for event in found)
        for kind, names in {
            "check": [f"check_{name}" for name in synthetic.CHECKS],
            "cue": ["cue0"],
            "hazard": ["unintended", "loss", "false_report"],
            "jump": ["jump_code"],
        }.items():
            times = sorted(row[f"{name}_first_ms"] for name in names)
            told = [event.tick for event in found if event.kind == kind]
            assert told == [ms for ms in times if ms >= 0], (kind, row["index"])
        states = [event.tick for event in found if event.kind in ("run level", "brakes")]
        assert states == [200, 204]

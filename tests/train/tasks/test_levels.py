"""Levels to proficiency: rounds, times and what leads on, with a tip that is put where it should
go.
"""

import pytest
from made_frames import TIPS, kinds, made, put, running

from ravenjax.train import tasks

LEVELS = [
    {"title": "one", "targets": 3, "tolerance_mm": 3, "dwell_ms": 0, "within_s": 1.0},
    {"title": "two", "targets": 2, "tolerance_mm": 2, "dwell_ms": 0, "within_s": 0.5},
]


def levels(in_a_row=2):
    chosen, _ = made(arms=["gold"], task={"kind": "levels", "in_a_row": in_a_row, "level": LEVELS})
    return tasks.make_task(chosen, {"gold": TIPS["gold"]}, 0), running(("gold",))


class Trainee:
    """Goes from target to target, so many ms for each."""

    def __init__(self, task, frame):
        self.task, self.frame, self.tick = task, frame, 0
        self.seen = []
        self.told = list(task.step(frame, 0))

    def round(self, each_ms):
        """One round; the events of it."""
        targets, events = {one["number"]: one["at"] for one in self.task.geometry()["targets"]}, []
        level = self.task.settings.level[self.task.result()["levels_proficient"]]
        for _ in range(level.targets):
            self.tick += each_ms
            self.seen.append(self.task.target)
            put(self.frame, "gold", targets[self.task.target])
            events += self.task.step(self.frame, self.tick)
        self.told += events
        return [event for event in events if event["kind"] == "level"]


def test_rounds_in_a_row_within_the_time_lead_on():
    one, frame = levels()
    trainee = Trainee(one, frame)
    assert [event["kind"] for event in trainee.told] == ["level", "target"]
    assert trainee.told[0]["level"] == 1 and trainee.told[0]["took_ms"] is None
    (first,) = trainee.round(500)  # from the first target to the third: 1 s
    told = lambda event: [event[k] for k in ("level", "took_ms", "within", "in_a_row")]  # noqa: E731
    assert told(first) == [1, 1000, True, 1]
    trainee.tick += 60_000  # who rests between rounds loses no time
    (slow,) = trainee.round(501)
    assert told(slow) == [1, 1002, False, 0]
    trainee.round(100)
    (on,) = trainee.round(100)
    assert told(on) == [2, 200, True, 0] and (on["title"], on["within_s"]) == ("two", 0.5)
    assert one.progress == pytest.approx(0.5) and not one.done
    trainee.round(500)
    assert trainee.round(500) == [] and one.done and one.target == -1
    assert kinds(trainee.told)[-2:] == ["task_done", "target"]
    assert trainee.seen == [0, 1, 2] * 4 + [3, 4] * 2  # a round has the same targets again
    result = one.result()
    assert (result["levels_proficient"], result["done"]) == (2, True)
    assert result["rounds_s_of_level"] == [[1.0, 1.002, 0.2, 0.2], [0.5, 0.5]]

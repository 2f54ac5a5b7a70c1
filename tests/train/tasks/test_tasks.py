"""Tasks of a session, with tips that are put where they should go."""

import numpy as np
import pytest
from made_frames import TIPS, kinds, made, put, running

from ravenjax.train import tasks
from ravenjax.train.protocol import tissue_height

BOTH = ("gold", "green")
OPEN, CLOSED = (0.785, 0.785), (0.3, 0.3)


def task(arms=("gold",), seed=0, **settings):
    chosen, _ = made(arms=list(arms), task=settings)
    return tasks.make_task(chosen, {arm: TIPS[arm] for arm in arms}, seed), running(arms)


def hold(one, frame, ticks, first=0):
    return [event for k in range(ticks) for event in one.step(frame, first + k)]


def jaws(frame, arm, opening):
    frame[f"{arm}/link_jpos"][5:7] = opening


# --- reach ---


def test_a_target_is_reached_by_holding_the_tip_there():
    one, frame = task(kind="reach", targets=3, dwell_ms=100, tolerance_mm=2)
    assert kinds(one.step(frame, 0)) == ["target"] and one.target == 0
    _, at = one.targets[0]
    put(frame, "gold", (at[0], at[1] + 0.0019, at[2]))
    assert hold(one, frame, 100, 1) == []
    put(frame, "gold", (at[0], at[1] + 0.0021, at[2]))  # out for a moment: the dwell begins anew
    assert hold(one, frame, 1, 101) == []
    put(frame, "gold", at)
    assert hold(one, frame, 100, 102) == []
    assert hold(one, frame, 1, 202) == [{"kind": "target", "target": 1}]
    assert one.progress == pytest.approx(1 / 3) and not one.done


def test_the_last_target_ends_the_task_and_the_numbers_are_right():
    one, frame = task(kind="reach", targets=2, dwell_ms=0)
    one.step(frame, 0)
    events = []
    for k in range(2):
        put(frame, "gold", one.targets[k][1])
        events += one.step(frame, 500 * (k + 1))
    assert kinds(events) == ["target", "task_done", "target"] and events[-1]["target"] == -1
    assert one.done and one.target == -1 and one.progress == 1.0
    assert one.next_aim("gold", (0, 0, 0)) is None
    assert one.result()["score"] == 100.0
    assert one.step(frame, 2000) == []


def test_arms_take_turns_and_only_the_one_whose_turn_it_is_counts():
    one, frame = task(BOTH, kind="reach", targets=4, dwell_ms=0)
    assert [arm for arm, _ in one.targets] == ["gold", "green", "gold", "green"]
    put(frame, "green", one.targets[0][1])
    hold(one, frame, 5)
    assert one.target == 0 and one.next_aim("green", (0, 0, 0)) is None
    put(frame, "gold", one.targets[0][1])
    hold(one, frame, 1)
    assert one.target == 1 and one.next_aim("green", (0, 0, 0)).point == one.targets[1][1]


# --- peg transfer ---


def carried(one, frame, arm, to, tick=0):
    """Grasp the object, carry it, let go."""
    put(frame, arm, one.object)
    jaws(frame, arm, OPEN)
    events = one.step(frame, tick)
    jaws(frame, arm, CLOSED)
    events += one.step(frame, tick + 1)
    put(frame, arm, to)
    events += one.step(frame, tick + 2)
    jaws(frame, arm, OPEN)
    return events + one.step(frame, tick + 3)


def test_the_object_is_taken_put_back_by_a_restart_carried_and_placed():
    one, frame = task(kind="peg_transfer", transfers=1)
    start, end = (one.pegs[k] for k in one.route)
    assert one.object == start and one.step(frame, 0)[0]["target"] == len(one.pegs)
    put(frame, "gold", start)
    jaws(frame, "gold", CLOSED)
    held, target = one.step(frame, 1)
    assert held["held"] == "gold" and target["target"] == one.route[1] and one.held == "gold"
    put(frame, "gold", (0.0, 0.0, 0.2))
    one.step(frame, 2)
    np.testing.assert_allclose(one.object, (0.0, 0.0, 0.2), atol=1e-8)
    one.restart()  # the robot that held it has moved away
    assert one.held is None and one.object == start
    placed = carried(one, frame, "gold", (end[0], end[1] + 0.001, end[2]), 3)[-3:]
    assert kinds(placed) == ["object", "task_done", "target"] and placed[0]["held"] == ""
    assert one.object == end and one.done and one.result()["score"] == 100.0


def test_what_is_let_go_elsewhere_drops_and_has_to_be_fetched():
    one, frame = task(kind="peg_transfer", transfers=2)
    carried(one, frame, "gold", (0.0, 0.0, 0.205))
    x, y, z = one.object
    assert one.dropped == 1 and (x, y) == pytest.approx((0, 0), abs=1e-8)
    assert z < tissue_height(0, 0) + 0.003
    assert one.target == len(one.pegs)
    carried(one, frame, "gold", one.pegs[one.route[1]], 10)
    assert (one.placed, one.dropped) == (1, 1) and one.result()["score"] == 25.0  # (1 - 0.5) of 2


# --- path ---


def test_following_the_line_counts():
    one, frame = task(kind="path", shape="circle", radius_mm=10, laps=1, tolerance_mm=2)
    for k in range(0, 201, 2):
        x, y, z = one.points[k % 200]
        put(frame, "gold", (x, y, z + 0.001))
        one.step(frame, k)
    assert one.done and one.progress == 1.0
    assert one.result()["score"] == 100.0


def test_a_short_cut_and_a_tip_off_the_line_do_not_advance():
    one, frame = task(kind="path", shape="circle", radius_mm=10, laps=1, tolerance_mm=2)
    for k in range(50):
        put(frame, "gold", one.points[k])
        one.step(frame, k)
    assert one.target == 49
    put(frame, "gold", one.points[150])  # across
    hold(one, frame, 20)
    x, y, z = one.points[52]
    put(frame, "gold", (x, y, z + 0.0025))
    hold(one, frame, 20)
    assert one.target == 49 and one.result()["score"] < 60 * one.progress
    put(frame, "gold", one.points[52])
    hold(one, frame, 1)
    assert one.target == 52


# --- levels ---

LEVELS = [
    {"title": "one", "targets": 3, "tolerance_mm": 3, "dwell_ms": 0, "within_s": 1.0},
    {"title": "two", "targets": 2, "tolerance_mm": 2, "dwell_ms": 0, "within_s": 0.5},
]


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
    one, frame = task(kind="levels", in_a_row=2, level=LEVELS)
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

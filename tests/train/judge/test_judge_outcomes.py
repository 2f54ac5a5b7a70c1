"""What a session says of a hazard, against the definitions of outcomes recomputed over whole
made-up courses.
"""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_frames import FAULT, made, running

from ravenjax.robots.raven2.declaration import CHECKS
from ravenjax.train.judge import Judge

TICKS, STRIKE, LOOK = 500, 40, 10
DISTANCES = ("unintended_mm", "loss_mm", "false_report_mm")
ACTIONS = {"stop": "stopped", "flag": "flagged", "limit": "limited"}


def course(seed: int, limit_mm: float) -> dict[str, np.ndarray]:
    """Channels of one arm, constant over 20 ms each, and counts of checks, [TICKS]; the pedal is
    always down.
    """
    rng = np.random.default_rng(seed)

    def blocks(values):
        return np.repeat(values, 20)[:TICKS]

    live = blocks(rng.random(25) < rng.choice([0.3, 0.9, 1.0]))
    data = {"live": live, "runlevel": np.where(live, 3, 2)}
    for name in DISTANCES:
        size = rng.choice([0.3, 0.9, 1.5])
        data[name] = (blocks(rng.uniform(0.0, size * limit_mm, 25)) * live).astype(np.float32)
    data["unintended_off_mm"] = (blocks(rng.uniform(0.0, 1.3 * limit_mm, 25)) * ~live).astype(
        np.float32
    )
    data["halted_ms"] = np.cumsum(~live)
    data["golden_halted_ms"] = np.cumsum(rng.random(TICKS) < rng.choice([0.0, 0.4]))
    for name in rng.choice(list(CHECKS), 4, replace=False):
        own, golden = (rng.random((2, TICKS)) < rng.choice([0.0, 0.004, 0.03], (2, 1))).astype(int)
        data[f"check_{name}"], data[f"golden_{name}"] = np.cumsum(own), np.cumsum(golden)
    return data


@functools.cache
def scenario_of(limit_mm):
    return made(hazard=[{"name": "h", "fault": FAULT}], harm={"excursion_mm": limit_mm})


def judged(data, limit_mm):
    """The judge's row, its events, and the rows of the frames as a recording has them."""
    chosen, hazards = scenario_of(limit_mm)
    events, rows, frame = [], [], running()
    tell = lambda kind, **facts: events.append({"kind": kind, **facts})  # noqa: E731
    judge = Judge(chosen, hazards, True, tell)
    names = [name.removeprefix("check_") for name in data if name.startswith("check_")]
    for tick in range(TICKS):
        if tick == STRIKE:
            judge.begin_hazard(0, tick)
        for name, values in data.items():
            if not name.startswith("check_") and name.removeprefix("golden_") not in names:
                frame[name if name in frame.layout.places else f"gold/{name}"] = values[tick]
        frame["tick"] = frame["session_tick"] = tick
        frame["fault_active"] = tick >= STRIKE
        outcomes = golden = None
        if tick % LOOK == 0:
            outcomes = {f"check_{name}_count": data[f"check_{name}"][tick] for name in names}
            outcomes |= {
                f"check_{name}_first_ms": first(data[f"check_{name}"][: tick + 1] > 0)
                for name in names
            }
            golden = {f"check_{name}_count": data[f"golden_{name}"][tick] for name in names}
        judge.step(tick, frame, outcomes, golden)
        rows.append(frame.row.copy())
    (row,) = judge.rows()
    return row, events, frame.layout, np.array(rows)


def first(happens) -> int:
    return int(np.argmax(happens)) if np.any(happens) else -1


def expected(data, limit_mm):
    """The same by the definitions, whole columns at a time."""
    after = {
        name: np.where(np.arange(TICKS) >= STRIKE, data[name], 0.0)
        for name in (*DISTANCES, "unintended_off_mm")
    }
    response, times = "silent", {}
    for name in (name.removeprefix("check_") for name in data if name.startswith("check_")):
        own, golden = data[f"check_{name}"], data[f"golden_{name}"]
        for tick in range(LOOK, TICKS, LOOK):
            if tick >= STRIKE and own[tick] > own[tick - LOOK] and own[tick] > golden[tick]:
                word = ACTIONS[CHECKS[name].action]
                ms = max(STRIKE, first(own > 0)) if own[tick - LOOK] == 0 else tick
                times[word] = min(times.get(word, TICKS), ms)
    for word in ("stopped", "flagged", "limited"):
        if word in times:
            response = word
            break
    over = {name: first(values > limit_mm) for name, values in after.items()}
    halted = [
        int(data[name][-1] - data[name][STRIKE - 1]) for name in ("halted_ms", "golden_halted_ms")
    ]
    if over["unintended_mm"] >= 0:
        word = "unintended motion"
    elif over["loss_mm"] >= 0 or (halted[0] - halted[1] > 200 and response != "stopped"):
        word = "loss of motion"
    else:
        word = "false report" if over["false_report_mm"] >= 0 else "none"
    farthest = max(after["unintended_mm"].max(), after["unintended_off_mm"].max())
    halts = bool(data["live"][STRIKE - 1] and not data["live"][STRIKE:].all())
    seen = (
        np.max([after[name] for name in ("unintended_mm", "unintended_off_mm", "loss_mm")], axis=0)
        >= 1.0
    )
    left = halts & (np.arange(TICKS) >= STRIKE) & ~data["live"]
    signs = [first(seen), first(left), *(times.get(word, -1) for word in ("stopped", "flagged"))]
    acts = min((ms for ms in signs if ms >= 0), default=TICKS) + 150  # nobody acts sooner
    spared = max(after[name][:acts].max() for name in ("unintended_mm", "unintended_off_mm"))
    if spared > limit_mm:
        outcome = "unavoidable"
    elif farthest > limit_mm:
        outcome = "harm"
    elif halts:
        outcome = "halted"
    else:
        small = max(values.max() for values in after.values()) < 1.0
        outcome = "unaffected" if small and word == "none" else "missed"
    told = [times[word] for word in ("stopped", "flagged") if word in times]
    return {
        "check_response": response,
        "motion_hazard": word,
        "alarm_ms": min(told, default=None),
        "limited_ms": times.get("limited"),
        "halted_ms": halted[0],
        "golden_halted_ms": halted[1],
        "halted": halts,
        "limit_mm": limit_mm,
        "outcome": outcome,
        **{name: pytest.approx(values.max(), abs=1e-4) for name, values in after.items()},
        **{
            name.replace("_mm", "_first_ms"): None if over[name] < 0 else over[name]
            for name in DISTANCES
        },
    }


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), limit_mm=st.sampled_from([0.7, 3.0, 4.5, 12.0]))
def test_an_episode_is_what_the_definitions_make_of_its_course(seed, limit_mm):
    data = course(seed, limit_mm)
    row, events, *_ = judged(data, limit_mm)
    for name, value in expected(data, limit_mm).items():
        assert row[name] == value, name
    kinds = {event["kind"] for event in events}
    assert ("alarm" in kinds) or row["alarm"] is None
    assert ("limited" in kinds) is (row["limited"] is not None)
    assert ("unintended_motion" in kinds) is (row["unintended_first_ms"] is not None)
    assert ("false_report" in kinds) is (row["false_report_first_ms"] is not None)

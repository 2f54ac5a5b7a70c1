"""The study of an operator who closes the loop: the fit on made-up operators, null models, and the
hands over a bad network.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ravenjax as rj
from studies.network_operator import HERE, fit
from studies.network_operator.fit import LOWEST, NORMAL, QUANTITIES, People

MEANS = {
    NORMAL: (20.0, 0.40, 0.50, 8.5),
    "PLM-10": (22.0, 0.40, 0.55, 9.35),
    "DLM-100": (24.0, 0.44, 0.55, 9.35),
    "CLM-10": (26.0, 0.40, 0.60, 12.0),
}


def made_up(truth: dict[str, tuple[float, ...]]) -> pd.DataFrame:
    """Runs of a grid whose rates change by a power of each number; the middle one is `truth`."""
    grid = ((0.7, 0.8, 0.9), (3.0, 6.0, 12.0), (0.5, 1.0, 2.0), (500.0, 1500.0, 4500.0))
    length = 6 * truth[NORMAL][1] / 2 * 1e3  # mm of one arm in a trial
    rows = []
    for numbers in np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 4):
        pace, wait, gain, patience = np.log(numbers / [0.8, 6.0, 1.0, 1500.0])
        for condition, (seconds, robot, hand, presses) in truth.items():
            bad = condition != NORMAL
            presses -= truth[NORMAL][3] * hand / truth[NORMAL][2]
            rates = (
                seconds * np.exp(-pace - bad * wait / 4),
                robot * 500 * np.exp(bad * gain / 4),
                hand * 500 * np.exp(-bad * gain / 4),
                presses / length * truth[NORMAL][1] * 500 * np.exp(-bad * patience),
            )
            found = dict(zip((*fit.NUMBERS, *fit.SIMULATED), (*numbers, *rates), strict=True))
            rows.append(found | {"condition": condition, "weight": 1.0, "done": 1.0})
    return pd.DataFrame(rows)


def test_the_fit_finds_the_operator_who_made_the_numbers() -> None:
    mean = np.array(list(MEANS.values()))
    # One arm moves half of both arms' path, and this in one s of progress
    people = People(tuple(MEANS), mean, 0.02 * mean)
    every = fit.operators(made_up(MEANS))
    best = fit.fit(every, people)
    ratios = every.ratios(people, "CLM-10")[best]
    np.testing.assert_allclose(ratios, mean[3] / mean[0], rtol=0.02)
    np.testing.assert_allclose(every.numbers[best][1:3], (6.0, 1.0), rtol=0.15)
    worse = people._replace(mean=mean * [1.0, 1.0, 1.1, 1.0] ** (np.arange(4)[:, None] > 0))
    assert every.numbers[fit.fit(every, worse)][2] < every.numbers[best][2]


def test_only_the_normal_condition_and_the_lowest_severities_are_kept(tmp_path: Path) -> None:
    rows = [[name, *(2.0 * k for k in range(1, 9))] for name in (*MEANS, "PLM-30", "CLM-50")]
    columns = [part for one in QUANTITIES for part in (one, f"{one}_sd")]
    pd.DataFrame(rows, columns=["condition", *columns]).to_csv(tmp_path / "x.csv")
    people = fit.read_people(tmp_path / "x.csv")
    assert people.conditions == (NORMAL, *LOWEST) and len(people.mean) == 4
    # Mean presses are rounded up
    assert people.at(NORMAL).tolist() == [2.0, 6.0, 10.0, 13.5]
    assert people.deviation[0].tolist() == [4.0, 8.0, 12.0, 16.0]
    null = fit.nulls("DLM-500", people)
    assert null["1 - p, 1 + delay"].tolist() == [1.5, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(fit.nulls("CLM-50", people)["1 - p, 1 + delay"], (2, 1, 2, 2))


@pytest.mark.slow
def test_the_hands_wait_while_nothing_arrives_and_go_on() -> None:
    """A loss costs time, and without patience the pedal is lifted."""
    raw = {
        "campaign": {"name": "x", "duration_s": 8.0},
        "operator": {"motion": "peg_transfer", "hands": str(HERE / "hands.py")},
        "cross": {"operator.own.hands.patience_ms": [400.0, 9000.0]},
        "group": [
            {"name": "free"},
            {
                "name": "cut",
                "fault": [
                    {"site": "network", "effect": "drop", "start_ms": 2000, "duration_ms": 2500}
                ],
            },
        ],
    }
    table = rj.run(raw, engine="simd")
    names = ["group", "param:operator.own.hands.patience_ms", "tip_path_mm", "pedal_down_ms"]
    found = {(group, of): rest for group, of, *rest in table[names].itertuples(index=False)}
    (free, down), (cut, still_down) = found["free", 9000.0], found["cut", 9000.0]
    assert 0.4 * free < cut < 0.8 * free
    assert found["free", 400.0][1] == down == still_down > found["cut", 400.0][1] + 400

"""Fits the operator who corrects by sight to people under network faults, and predicts results
under worse faults.

The simulated quantities are rates per progress in the plan, on a grid of the operator's parameters,
interpolated linearly in the logarithms. The fit compares ratios to the condition without a fault,
in which the scale of a console and the length of a task cancel. The published table has means and
standard deviations over people. A bootstrap draws the mean of every cell again. It treats the cells
as independent, so the intervals are too wide rather than too narrow.
"""

import math
from collections.abc import Iterable, Mapping
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.interpolate import RegularGridInterpolator

NORMAL = "Normal"
LOWEST = ("PLM-10", "DLM-100", "CLM-10")
"""Conditions that the fit may see, beside NORMAL."""
WORSE = ("PLM-30", "PLM-50", "DLM-300", "DLM-500", "CLM-30", "CLM-50")
LOST = {"PLM-10": 0.098, "PLM-30": 0.306, "PLM-50": 0.505}
LOST |= {"CLM-10": 0.15, "CLM-30": 1 / 3, "CLM-50": 0.5}
"""Share of packets that the network of a condition loses."""
DELAY_S = {"DLM-100": 0.1, "DLM-300": 0.299, "DLM-500": 0.5}
PEOPLE, TRANSFERS = 15, 6
"""Participants, and transfers of a trial, over which presses are counted."""
QUANTITIES = ("transfer_s", "robot_path_m", "console_path_m", "pedal_presses")
ROUNDED_UP = 0.5
"""Mean presses are published rounded up to a whole number, so on average half a press too high."""
NUMBERS = ("pace", "wait_mm", "correct_per_s", "patience_ms")
FINE = (9, 16, 16, 7)
"""Number of values of each number among which the fit chooses."""
RESAMPLES = 1000
PROPORTION = "proportional to the mildest fault"
SIMULATED = ("time", "robot", "hand", "tests")


class People(NamedTuple):
    """Published means, and standard deviations over people, [conditions, QUANTITIES]."""

    conditions: tuple[str, ...]
    mean: np.ndarray
    deviation: np.ndarray

    def at(self, condition: str) -> np.ndarray:
        """Return the means of a condition."""
        return self.mean[self.conditions.index(condition)]

    def drawn(self, random: np.random.Generator) -> "People":
        """Return means of as many other people."""
        error = self.deviation / math.sqrt(PEOPLE) * random.normal(size=self.mean.shape)
        rounded = np.zeros_like(error)
        rounded[:, 3] = random.uniform(-ROUNDED_UP, ROUNDED_UP, len(error))
        mean = np.maximum(self.mean + error + rounded, 0.1 * self.mean)
        return self._replace(mean=mean)


def read_people(path: Path) -> People:
    """Read NORMAL and LOWEST of the published table. Other rows are dropped."""
    table = pd.read_csv(path).set_index("condition").loc[[NORMAL, *LOWEST]]
    mean = table[list(QUANTITIES)].to_numpy(float)
    mean[:, 3] -= ROUNDED_UP
    return People((NORMAL, *LOWEST), mean, table[[f"{q}_sd" for q in QUANTITIES]].to_numpy(float))


class Operators(NamedTuple):
    """Results of each operator of a fine grid, by condition."""

    numbers: np.ndarray  # [operators, NUMBERS]
    # [operators, SIMULATED]: s, mm of the tip, mm of the hand (times the scale) and clutches
    # because the tip does not follow, per s of progress in the plan
    rates: Mapping[str, np.ndarray]

    def distance_squared(self) -> np.ndarray:
        """Return the squared distance from the grid's middle, in half-widths of logarithms."""
        logs = np.log(self.numbers)
        low, high = logs.min(axis=0), logs.max(axis=0)
        return (((2 * logs - low - high) / (high - low)) ** 2).sum(axis=1)

    def reach(self, people: People) -> np.ndarray:
        """Return the motion of the hand from clutch to clutch (mm) that gives the published presses
        without a fault, [operators]; NaN where the operator clutches too often without it.
        """
        normal = self.rates[NORMAL]
        presses = people.at(NORMAL)[3] / self._progress(people) - normal[:, 3]
        return np.where(presses > 0, normal[:, 2] / np.where(presses > 0, presses, 1.0), np.nan)

    def _progress(self, people: People) -> np.ndarray:
        """Return the progress of a trial, s, in which one arm moves half of both arms' path."""
        return TRANSFERS * people.at(NORMAL)[1] / 2 * 1e3 / self.rates[NORMAL][:, 1]

    def ratios(self, people: People, condition: str) -> np.ndarray:
        """Return the ratios of QUANTITIES to those without a fault, [operators, QUANTITIES]."""
        here, normal = self.rates[condition], self.rates[NORMAL]
        presses = (here[:, 2] / self.reach(people) + here[:, 3]) * self._progress(people)
        return np.column_stack([here[:, :3] / normal[:, :3], presses / people.at(NORMAL)[3]])

    def seconds(self, people: People) -> np.ndarray:
        """Return the time of a transfer without a fault, s [operators]."""
        return self._progress(people) / TRANSFERS * self.rates[NORMAL][:, 0]


def operators(runs: pd.DataFrame) -> Operators:
    """Return the operators between those of the runs (columns NUMBERS, SIMULATED, `condition`, and
    `weight` among the runs of a condition).
    """
    values = [np.unique(runs[name].to_numpy(float)) for name in NUMBERS]
    fine = [np.geomspace(at[0], at[-1], n) for at, n in zip(values, FINE, strict=True)]
    numbers = np.stack(np.meshgrid(*fine, indexing="ij"), axis=-1).reshape(-1, len(NUMBERS))
    # Rounding must not place a number outside of the grid
    inside = np.clip(np.log(numbers), *(np.log([at[end] for at in values]) for end in (0, -1)))
    rates = {}
    for condition, mine in runs.sort_values([*NUMBERS]).groupby("condition"):
        weighted = mine[[*SIMULATED, "done"]].to_numpy(float) * mine[["weight"]].to_numpy(float)
        # Of each operator: the runs of all lengths of losses, and of all motions
        runs_of_each = weighted.reshape(*map(len, values), -1, weighted.shape[1])
        total = reduce(np.add, np.moveaxis(runs_of_each, -2, 0))
        # An operator who makes no progress needs very long, not infinitely
        done = np.maximum(total[..., -1], 1e-3 * total[..., 0])
        grid = total[..., :-1] / done[..., None]
        at = RegularGridInterpolator([np.log(of) for of in values], grid)
        rates[str(condition)] = at(inside)
    return Operators(numbers, rates)


def errors(people: People, condition: str) -> np.ndarray:
    """Return the standard errors of the logarithms of ratios to NORMAL, [QUANTITIES]."""
    relative = people.deviation / people.mean
    here = relative[people.conditions.index(condition)]
    square = (here**2 + relative[0] ** 2) / PEOPLE
    square[3] += 2 * (ROUNDED_UP / people.at(NORMAL)[3]) ** 2 / 3
    return np.sqrt(square)


def residuals(found: np.ndarray, people: People, condition: str) -> np.ndarray:
    """Return the residuals of ratios against the published ratios, in standard errors."""
    wanted = people.at(condition) / people.at(NORMAL)
    return (np.log(found) - np.log(wanted)) / errors(people, condition)


def fit(every: Operators, people: People, seen: Iterable[str] = LOWEST) -> int:
    """Return the number of the best operator for the time without a fault and the ratios of these
    conditions. The prior is normal: the grid ends one standard deviation from its middle.
    """
    error = np.sqrt((people.deviation[0, :2] ** 2 / people.mean[0, :2] ** 2).sum() / PEOPLE)
    parts = [np.log(every.seconds(people) / people.at(NORMAL)[0])[:, None] / error]
    parts += [residuals(every.ratios(people, one), people, one) for one in seen]
    square = np.concatenate(parts, axis=1) ** 2
    square = np.where(np.isfinite(square), square, 1e6)
    return int((square.sum(axis=1) + every.distance_squared()).argmin())


def mildest(condition: str) -> str:
    """Return the condition of LOWEST with the same kind of network fault."""
    return next(one for one in LOWEST if one[:3] == condition[:3])


def nulls(condition: str, people: People) -> dict[str, np.ndarray]:
    """Return the ratios to NORMAL that null models predict, by the model's name."""
    more, delay = 1 / (1 - LOST.get(condition, 0.0)), DELAY_S.get(condition, 0.0)
    lowest, severity = mildest(condition), {**LOST, **DELAY_S}
    slope = severity[condition] / severity[lowest]
    return {
        "as without a fault": np.ones(4),
        "1 - p, 1 + delay": np.array([more * (1 + delay), 1.0, more, more]),
        PROPORTION: 1 + (people.at(lowest) / people.at(NORMAL) - 1) * slope,
    }

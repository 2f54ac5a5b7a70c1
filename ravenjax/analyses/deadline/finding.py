"""Finds deadlines by bisection: the tick of an action is halved until it just prevents the harm.

All faults and actions take part in each round, one lane each. The rounds run `HORIZON_MS` beyond the
latest action. Every deadline that they find is then confirmed by a run of full length, and some
earlier ticks are tried, which may fail where the later one does not.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign.computation import Computation
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection.explain import Explainer
from ravenjax.campaign.inspection.replay import PlannedCampaign
from ravenjax.campaign.progress import Progress
from ravenjax.errors import UserError
from ravenjax.report.data.runs import UNINTENDED, Runs
from ravenjax.report.run import chain
from ravenjax.vocabulary.effects import TRIGGER_CODES

HORIZON_MS = 300
"""How long the runs of a round last after the action. Most harm comes sooner."""
TRIED = 3
"""Number of ticks before each deadline that are tried, the earliest at the fault's first effect."""


class Lanes(NamedTuple):
    """Pairs of a fault and an action, int arrays [lanes]."""

    row: np.ndarray  # of the fault table
    action: np.ndarray  # number of the action
    effect: np.ndarray  # tick of the fault's first effect
    harm: np.ndarray  # tick of the harm without the action

    def where(self, some: np.ndarray) -> "Lanes":
        """Return some of the lanes (bool [lanes])."""
        return Lanes(*(values[some] for values in self))


class Actor(PlannedCampaign):
    """Runs faults of a campaign again, each with an action."""

    def __init__(self, config: CampaignConfig, engine: str = "auto") -> None:
        """Raises UserError if the campaign, its robot or the engine does not support this."""
        part = config.robot.part("campaign")
        if not hasattr(part, "acted"):
            raise UserError(
                f"robot {config.campaign.robot!r} declares no actions, so no deadline can be found:"
                " expected a robot whose part `campaign` has `acted`, as raven2"
            )
        super().__init__(config, engine)
        program, self.actions = part.acted(self.plan.program)
        self._acted = dataclasses.replace(
            self.plan, program=dataclasses.replace(program, ends=True)
        )
        self.runs = 0  # computed so far
        self._work: Computation | None = None

    def harmful(self, lanes: Lanes, at: np.ndarray, horizon: int | None = None) -> np.ndarray:
        """Return whether harm comes although the action is taken at tick `at`, bool [lanes].

        horizon: ticks after the last action on the same golden run; None: until the runs end. Harm
        is motion beyond the limit, also while the robot coasts to a stop.
        """
        if not len(at):
            return np.zeros(0, bool)
        some = self._acted.take(lanes.row)
        slot = {
            "code": lanes.action,
            "trigger": np.full(len(at), TRIGGER_CODES["time"]),
            "start": at,
            "duration": lanes.effect,
        }
        none = np.zeros(len(at))
        faults = {
            name: np.column_stack([values, slot.get(name, none)]).astype(values.dtype)
            for name, values in some.faults.items()
        }
        golden = np.unique(some.golden, return_inverse=True)[1].astype(np.int32)
        ends = self.plan.ends[lanes.row]
        if horizon is not None:
            # Runs of one golden run end together, because an end of its own has a cost.
            last = np.zeros(golden.max() + 1, np.int32)
            np.maximum.at(last, golden, at + horizon)
            ends = np.minimum(ends, last[golden])
        some = dataclasses.replace(some, faults=faults, golden=golden)
        vars(some)["ends"] = ends.astype(np.int32)
        if self._work is None:
            progress = Progress(self.engine, some.runs, some.runs, some.program.ticks)
            self._work = Computation(some, self.backend, progress)
            self._work.compile()
        outcomes, _ = self._work.of(some).tables([range(some.runs)])
        self.runs += some.runs
        limit = np.float32(self.config.outcomes.limit_mm)
        return (
            (outcomes["unintended_first_ms"] >= 0)
            | (outcomes["unintended_off_mm"] > limit)
            | (outcomes["failed_ms"] >= 0)
        )

    def find(self, lanes: Lanes, tell: Callable[[str], None]) -> tuple[np.ndarray, np.ndarray]:
        """Return the last tick at which each action prevents the harm, int [lanes], and whether
        all earlier ticks that were tried do so too, bool [lanes].

        The tick before the effect means that the action prevents nothing.
        """
        low, high = lanes.effect - 1, lanes.harm + 1

        def halve(some: np.ndarray, horizon: int | None) -> None:
            at = lanes.effect
            while some.any():
                tell(f"{int(some.sum())} runs with an action")
                fails = np.zeros(len(some), bool)
                fails[some] = self.harmful(lanes.where(some), at[some], horizon)
                high[some & fails], low[some & ~fails] = at[some & fails], at[some & ~fails]
                some = some & (high - low > 1)
                at = (low + high) // 2

        halve(high - low > 1, HORIZON_MS)
        found = low >= lanes.effect
        tell(f"{int(found.sum())} runs that confirm a deadline")
        late = np.zeros(len(found), bool)
        late[found] = self.harmful(lanes.where(found), low[found])
        high[late], low[late] = low[late], lanes.effect[late] - 1
        halve(late & (high - low > 1), None)
        monotone = np.ones(len(found), bool)
        for part in range(TRIED):
            at = lanes.effect + (low - lanes.effect) * part // TRIED
            some = at < low
            tell(f"{int(some.sum())} runs with an earlier action")
            monotone[some] &= ~self.harmful(lanes.where(some), at[some])
        return low, monotone

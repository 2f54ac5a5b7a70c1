"""Finds the last tick in which an action still prevents the harm of a fault: the deadline.

Each action is first simulated at the ticks of a coarse grid. The grid shows whether an action fails
at one tick and succeeds at a later one. A bisection then starts at the last tick of the grid at
which the action prevents the harm. Runs of the bisection end `HORIZON_MS` after the action. A run
of full length confirms each deadline.
"""

import contextlib
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
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import UNINTENDED, Runs
from ravenjax.report.run import chain
from ravenjax.store import manifest
from ravenjax.vocabulary.effects import TRIGGER_CODES
from ravenjax.vocabulary.reactions import NONE

COLUMNS = "run action deadline_ms effect_ms visible_ms margin_ms monotone harms_alone"
"""Columns of the table, separated by spaces."""
REACTION_MS = 250
"""Assumed time from the cue to an operator's action, for a robot without section [reaction]."""
HORIZON_MS = 300
"""Duration of the bisection's runs after the action, ms. Most harm occurs sooner."""
GRID = 8
"""Number of ticks that are tried for each fault and action before the bisection. They lie between
the fault's first effect and the harm.
"""


class Lanes(NamedTuple):
    """Pairs of a fault and an action, int arrays [lanes]."""

    row: np.ndarray  # row of the fault in the fault table
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
                f"robot {config.campaign.robot!r} declares no actions, so no deadline can be found."
                " Expected a function `acted` in the robot's part `campaign`"
            )
        super().__init__(config, engine)
        program, self.actions = part.acted(self.plan.program)
        self._acted = dataclasses.replace(
            self.plan, program=dataclasses.replace(program, ends=True)
        )
        reaction = "reaction.delay_ms"
        assumed = getattr(program.params, "reaction", None)
        usual_ms = REACTION_MS if assumed is None else assumed.delay_ms
        self.delay_ms = self.plan.varied.get(reaction, np.full(self.plan.runs, usual_ms))
        """Time from the cue to the operator's action, ms, for each run."""
        self._work: Computation | None = None

    def run(
        self, lanes: Lanes, at: np.ndarray, horizon: int | None = None, alone: bool = False
    ) -> dict[str, np.ndarray]:
        """Run each fault again with an action at tick `at` [lanes]. Return outcomes, each [lanes].

        horizon: number of simulated ticks after the last action on the same golden run; None: until
        the end of the runs. alone: run the action without the fault.
        """
        some = self._acted.take(lanes.row)
        slot = {
            "code": lanes.action,
            "trigger": np.full(len(at), TRIGGER_CODES["time"]),
            "start": at,
            "duration": lanes.effect,
        }
        none = np.zeros(len(at))
        faults = {
            name: np.column_stack([values * (not alone), slot.get(name, none)]).astype(values.dtype)
            for name, values in some.faults.items()
        }
        golden = np.unique(some.golden, return_inverse=True)[1].astype(np.int32)
        ends = self.plan.ends[lanes.row]
        if horizon is not None:
            # All runs of a golden run end together, because each different end costs time.
            last = np.zeros(golden.max() + 1, np.int32)
            np.maximum.at(last, golden, at + horizon)
            ends = np.minimum(ends, last[golden])
        some = dataclasses.replace(some, faults=faults, golden=golden)
        vars(some)["ends"] = ends.astype(np.int32)
        if self._work is None:
            progress = Progress(self.engine, some.runs, some.runs, some.program.ticks)
            self._work = Computation(some, self.backend, progress)
            self._work.compile()
        return self._work.of(some).tables([range(some.runs)])[0]

    def harmful(
        self, lanes: Lanes, at: np.ndarray, horizon: int | None = None, alone: bool = False
    ) -> np.ndarray:
        """Return whether harm occurs despite the action, bool [lanes]. Arguments: see `run`.

        Harm is an unintended motion beyond the limit, even while the robot coasts to a stop, and
        any harm that the campaign defines.
        """
        if not len(at):
            return np.zeros(0, bool)
        found, limit = self.run(lanes, at, horizon, alone), self.config.outcomes.limit_mm
        moved = (found["unintended_first_ms"] >= 0) | (found["failed_ms"] >= 0)
        if not self.config.limit_counts:
            return moved
        return moved | (found["unintended_off_mm"] > np.float32(limit))

    def find(self, lanes: Lanes, report: Callable[[str], None]) -> tuple[np.ndarray, np.ndarray]:
        """Return the last tick at which each action prevents the harm, int [lanes], and whether
        it does so at all earlier ticks of the grid, bool [lanes].

        If the action never prevents the harm, the result is the tick before the fault's effect. A
        later tick between two ticks of the grid is not found if neither of these prevents the harm.
        """
        count, every = len(lanes.row), np.arange(GRID + 1)
        # Ticks of the grid, [lanes, GRID + 1], from the effect to the tick after the harm.
        grid = lanes.effect[:, None] + (lanes.harm + 1 - lanes.effect)[:, None] * every // GRID
        report(f"{count * GRID} runs with an action")
        each = Lanes(*(np.repeat(values, GRID) for values in lanes))
        fails = self.harmful(each, grid[:, :-1].ravel()).reshape(count, GRID)
        # Index of the last tick that prevents the harm; GRID if no tick does.
        last = np.where(fails.all(axis=1), GRID, GRID - 1 - (~fails[:, ::-1]).argmax(axis=1))
        monotone = ~(fails & (every[:-1] < last[:, None])).any(axis=1) | (last == GRID)
        ends = np.column_stack([grid, lanes.effect - 1, lanes.effect])
        place, from_place = np.arange(count), np.where(last == GRID, GRID + 1, last)
        low, high = ends[place, from_place], ends[place, from_place + 1]

        def halve(horizon: int | None) -> None:
            # Halves each interval until the last tick that prevents the harm is known. The action
            # prevents the harm at tick `low` and not at tick `high`.
            while (some := high - low > 1).any():
                report(f"{int(some.sum())} runs with an action")
                at = ((low + high) // 2)[some]
                late = self.harmful(lanes.where(some), at, horizon)
                high[some], low[some] = (
                    np.where(late, at, high[some]),
                    np.where(late, low[some], at),
                )

        halve(HORIZON_MS // self.plan.tick_ms)
        report(f"{int((last < GRID).sum())} runs of full length that confirm a deadline")
        late = last < GRID
        late[late] = self.harmful(lanes.where(late), low[late])
        high[late], low[late] = low[late], ends[late, last[late]]
        halve(None)
        return low, monotone


def find_deadlines(
    folder: Path,
    engine: str = "auto",
    group: str | None = None,
    report: Callable[[str], None] = lambda text: None,
) -> pd.DataFrame:
    """Return the deadlines of the harmful faults of a result folder, as `read_deadlines` does.

    group: only the faults of this group. Faults that do not harm when they are run again are left
    out. report: is called with a line about the progress. Raise UserError, and StoreError as
    `manifest.read_manifest`.
    """
    record = manifest.read_manifest(folder)
    with contextlib.closing(Runs.open(folder, record)) as runs:
        if group is not None and group not in (names := runs.groups()):
            raise UserError(f"--group {group!r}: no such group, expected one of {', '.join(names)}")
        found = runs.table.rows(
            f'SELECT row, action FROM {FACTS} WHERE {UNINTENDED} AND coalesce("group"::VARCHAR = ?,'
            " true) ORDER BY row",
            [group],
        )
    rows, reactions = np.array(found, int).reshape(-1, 2).T
    if (reactions != NONE).any():
        raise UserError(
            f"{folder}: the operator reacts to the cue in every run, so no run shows the harm"
            ' without an action. Write [reaction] action = "none", or add 0 to reaction.action in'
            " [cross], and run the campaign again"
        )
    if not len(rows):
        return pd.DataFrame()
    actor, explainer = Actor.of_folder(folder, engine), Explainer.of_folder(folder, engine)
    report(f"{len(rows)} harmful runs that are compared with their golden runs")
    shown = explainer.explain(rows)
    leaves = [name for name in shown.ticks if str(name).startswith(chain.LEAVES)]
    faults = pd.DataFrame(
        {
            "run": shown.results["run_id"],
            "row": rows,
            "effect_ms": shown.results["first_active_ms"].astype(int),
            "harm": shown.results["unintended_first_ms"].astype(int),
            "visible": chain.earliest_time(shown.ticks[leaves].to_numpy().T),
        }
    )
    tick_ms = actor.plan.tick_ms
    each = faults[faults["harm"] >= 0].merge(
        pd.DataFrame({"action": list(actor.actions), "number": actor.actions.values()}), how="cross"
    )
    times = (each[name].to_numpy() // tick_ms for name in ("effect_ms", "harm"))
    lanes = Lanes(each["row"].to_numpy(), each["number"].to_numpy(), *times)
    last, each["monotone"] = actor.find(lanes, report)
    each["deadline_ms"] = (last - lanes.effect) * float(tick_ms)
    report(f"{len(each)} runs with an action but no fault")
    each["harms_alone"] = actor.harmful(lanes, lanes.effect, alone=True)
    # An operator who follows the cue takes the robot's first action.
    cue = each[each["number"] == 1].assign(action="cue")
    cue["deadline_ms"] -= actor.delay_ms[cue["row"]]
    whole = pd.concat([each, cue], ignore_index=True)
    seen = whole["visible"]
    whole["visible_ms"] = (seen - whole["effect_ms"]).where(seen >= 0)
    whole["margin_ms"] = whole["deadline_ms"] - whole["visible_ms"]
    return whole.reindex(columns=COLUMNS.split())

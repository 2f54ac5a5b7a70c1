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
from ravenjax.errors import UserError
from ravenjax.numbers import paths
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import UNINTENDED, Runs
from ravenjax.report.run import chain
from ravenjax.store import manifest
from ravenjax.vocabulary import seams
from ravenjax.vocabulary.effects import TRIGGER_CODES
from ravenjax.vocabulary.reactions import NONE

COLUMNS = "run action deadline_ms effect_ms visible_ms margin_ms monotone harms_alone"
"""Columns of the table, separated by spaces."""
REACTION_MS = 250
"""Assumed time from the cue to an operator's action, for a robot without section [reaction]."""
HORIZON_MS = 300
"""Duration of the bisection's runs after the action, ms. Most harm occurs sooner."""
GRID = 8
"""Ticks between a fault's first effect and the harm that are tried before the bisection."""


class FaultActions(NamedTuple):
    """Pairs of a fault and an action, int arrays [pairs]."""

    row: np.ndarray  # row of the fault in the fault table
    action: np.ndarray  # number of the action
    effect: np.ndarray  # tick of the fault's first effect
    harm: np.ndarray  # tick of the harm without the action

    def where(self, mask: np.ndarray) -> "FaultActions":
        """Return the pairs for which `mask` (bool [pairs]) is true."""
        return FaultActions(*(values[mask] for values in self))


class Actor(PlannedCampaign):
    """Runs faults of a campaign again, each with an action."""

    def __init__(self, config: CampaignConfig, engine: str):
        """Raise UserError if the campaign, its robot or the engine does not support actions."""
        part = config.robot.part("campaign")
        if not hasattr(part, "acted"):
            raise UserError(
                f"robot {config.campaign.robot!r} declares no actions, so no deadline can be found."
                " Expected a function `acted` in the module `campaign` of the robot's package"
            )
        super().__init__(config, engine)
        program, self.actions = part.acted(self.plan.program)
        # Each run may end at another tick.
        program = dataclasses.replace(program, ends=True)
        self._acting_plan = dataclasses.replace(self.plan, program=program)
        numbers = dict(paths.path_leaves(program.params, program.setup))
        default_delays = np.full(self.plan.runs, numbers.get("reaction.delay_ms", REACTION_MS))
        self.delay_ms = self.plan.varied.get("reaction.delay_ms", default_delays)
        """Time from the cue to the operator's action, ms, for each run."""
        self._computation: Computation | None = None

    def run(
        self, pairs: FaultActions, at: np.ndarray, horizon: int | None = None, alone: bool = False
    ) -> dict[str, np.ndarray]:
        """Run each fault again with its action at tick `at` [pairs]. Return outcomes, each [pairs].

        horizon: number of simulated ticks after the last action on the same golden run; None: until
        the end of the runs. alone: True runs the actions without the faults.
        """
        plan = self._acting_plan.take(pairs.row)
        # The additional fault slot holds the action.
        action_slot = {
            "code": pairs.action,
            "trigger": np.full(len(at), TRIGGER_CODES["time"]),
            "start": at,
            "duration": pairs.effect,
        }
        zeros = np.zeros(len(at))
        faults = {}
        for name, values in plan.faults.items():
            # A slot of zeros is empty.
            slots = np.zeros_like(values) if alone else values
            columns = np.column_stack([slots, action_slot.get(name, zeros)])
            faults[name] = columns.astype(values.dtype)
        # The golden runs of these rows, numbered from 0.
        golden = np.unique(plan.golden, return_inverse=True)[1].astype(np.int32)
        ends = self.plan.ends[pairs.row]
        if horizon is not None:
            # All runs of a golden run end together, because each different end costs time.
            last = np.zeros(golden.max() + 1, np.int32)
            np.maximum.at(last, golden, at + horizon)
            ends = np.minimum(ends, last[golden])
        plan = dataclasses.replace(plan, faults=faults, golden=golden)
        # `ends` is a cached property, whose value is replaced.
        vars(plan)["ends"] = ends.astype(np.int32)
        if self._computation is None:
            self._computation = Computation(plan, self.backend)
        return self._computation.of(plan).tables([range(plan.runs)])[0]

    def harmful(
        self, pairs: FaultActions, at: np.ndarray, horizon: int | None = None, alone: bool = False
    ) -> np.ndarray:
        """Return whether harm occurs although the action begins at tick `at`, bool [pairs].

        Harm is an unintended motion, a harm that the campaign defines, or a failed run. Motion
        beyond `limit_mm` while the robot coasts to a stop is harm, too. horizon: number of ticks to
        simulate after the action; None: all. alone: True simulates the actions without the faults.
        """
        if not len(at):
            return np.zeros(0, bool)
        outcomes = self.run(pairs, at, horizon, alone)
        # unintended_first_ms is also the time of a harm that the campaign defines.
        harms = (outcomes["unintended_first_ms"] >= 0) | (outcomes["failed_ms"] >= 0)
        # A campaign may define a harm that replaces the limit `limit_mm`.
        if not self.config.limit_counts:
            return harms
        limit_mm = np.float32(self.config.outcomes.limit_mm)
        return harms | (outcomes["unintended_off_mm"] > limit_mm)

    def find(
        self, pairs: FaultActions, report: Callable[[str], None]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the last tick at which each action prevents the harm, int [pairs], and whether
        it does so at all earlier ticks of the grid, bool [pairs].

        If the action never prevents the harm, the result is the tick before the fault's effect. A
        later tick between two ticks of the grid is not found if neither of these prevents the harm.
        """
        count, steps = len(pairs.row), np.arange(GRID + 1)
        # Ticks of the grid, [pairs, GRID + 1], from the effect to the tick after the harm.
        grid = pairs.effect[:, None] + (pairs.harm + 1 - pairs.effect)[:, None] * steps // GRID
        report(f"{count * GRID} runs: each action at {GRID} times from the fault's effect to harm")
        repeated = FaultActions(*(np.repeat(values, GRID) for values in pairs))
        fails = self.harmful(repeated, grid[:, :-1].ravel()).reshape(count, GRID)
        # Index of the last tick that prevents the harm; GRID if no tick does.
        last = np.where(fails.all(axis=1), GRID, GRID - 1 - (~fails[:, ::-1]).argmax(axis=1))
        monotone = ~(fails & (steps[:-1] < last[:, None])).any(axis=1) | (last == GRID)
        # The interval to bisect. Two more columns stand for an action that never prevents harm.
        edges = np.column_stack([grid, pairs.effect - 1, pairs.effect])
        number, first = np.arange(count), np.where(last == GRID, GRID + 1, last)
        low, high = edges[number, first], edges[number, first + 1]

        def bisect(horizon: int | None):
            # Halves each interval until the last tick that prevents the harm is known. The action
            # prevents the harm at tick `low` and not at tick `high`. horizon: number of ticks to
            # simulate after the action; None: until the end of the run.
            while (active := high - low > 1).any():
                report(f"{int(active.sum())} runs: halve the time in which each deadline lies")
                middle = ((low + high) // 2)[active]
                is_late = self.harmful(pairs.where(active), middle, horizon)
                high[active] = np.where(is_late, middle, high[active])
                low[active] = np.where(is_late, low[active], middle)

        bisect(HORIZON_MS // self.plan.tick_ms)
        report(f"{int((last < GRID).sum())} runs of full length: confirm each deadline")
        # Pairs whose run of full length does harm: the deadline is earlier.
        is_late = last < GRID
        is_late[is_late] = self.harmful(pairs.where(is_late), low[is_late])
        high[is_late] = low[is_late]
        low[is_late] = edges[is_late, last[is_late]]
        bisect(None)
        return low, monotone


def find_deadlines(
    folder: Path, engine: str, group: str | None, report: Callable[[str], None]
) -> pd.DataFrame:
    """Return the deadlines of a folder's harmful faults, as `explained.read_deadlines` does.

    group: only the faults of this group. Faults that do not harm when run again are left out.
    report: is called with a line about the progress. Raise UserError, and StoreError as
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
            f"{folder}: in every run the operator reacts to the haptic cue, so no run shows the"
            ' harm without a reaction. Write action = "none" in [reaction], or, if [cross] contains'
            " reaction.action, add 0 (none) to its values. Then run the campaign again"
        )
    if not len(rows):
        return pd.DataFrame()
    actor, explainer = Actor.of_folder(folder, engine), Explainer.of_folder(folder, engine)
    report(f"{len(rows)} harmful runs: compare each with its golden run")
    explanations = explainer.explain(rows)
    leaves = [name for name in explanations.ticks if str(name).startswith(seams.LEAVES)]
    faults = pd.DataFrame(
        {
            "run": explanations.results["run_id"],
            "row": rows,
            "effect_ms": explanations.results["first_active_ms"].astype(int),
            "harm": explanations.results["unintended_first_ms"].astype(int),
            "visible": chain.earliest_time(explanations.ticks[leaves].to_numpy().T),
        }
    )
    actions = pd.DataFrame({"action": list(actor.actions), "number": actor.actions.values()})
    table = faults[faults["harm"] >= 0].merge(actions, how="cross")
    tick_ms = actor.plan.tick_ms
    times = (table[name].to_numpy() // tick_ms for name in ("effect_ms", "harm"))
    pairs = FaultActions(table["row"].to_numpy(), table["number"].to_numpy(), *times)
    last, table["monotone"] = actor.find(pairs, report)
    table["deadline_ms"] = (last - pairs.effect) * float(tick_ms)
    report(f"{len(table)} runs without a fault: does the action alone do harm?")
    table["harms_alone"] = actor.harmful(pairs, pairs.effect, alone=True)
    # An operator who follows the cue takes the robot's first action, after a reaction time.
    cue = table[table["number"] == 1].assign(action="cue")
    cue["deadline_ms"] -= actor.delay_ms[cue["row"]]
    table = pd.concat([table, cue], ignore_index=True)
    visible = table["visible"]
    table["visible_ms"] = (visible - table["effect_ms"]).where(visible >= 0)
    table["margin_ms"] = table["deadline_ms"] - table["visible_ms"]
    return table.reindex(columns=COLUMNS.split())

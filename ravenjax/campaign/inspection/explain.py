"""Computes many runs again, each compared with its golden run at every seam of the tick.

`stages.explained` adds the comparison to the robot's tick. Runs are then computed like any
campaign. Ten thousand runs of 3 s take seconds on two cores.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign import outcomes
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection.replay import PlannedCampaign
from ravenjax.campaign.progress import OnProgress, Progress
from ravenjax.engines import selection
from ravenjax.errors import UserError, suggest_name
from ravenjax.stages.explained import HARM, explain_program
from ravenjax.vocabulary import seams

MOST = 200_000
"""Largest number of runs that are explained together, which need about 1 GB of memory."""
PREFIXES = (seams.DIFFERS, seams.LEAVES, seams.NEAR, seams.GOLDEN_NEAR, seams.NEAR_MS)
"""Beginnings of the columns that the observer adds to a run's outcomes, in addition to HARM."""


class Explained(NamedTuple):
    """Explained runs, one row each in both tables, in the order in which they were given."""

    results: pd.DataFrame  # the runs' rows of the result table, computed again
    # Columns run_id, index and harm_ms, and one column for each combination of a prefix in PREFIXES
    # and a number or check of the robot; times in ms.
    ticks: pd.DataFrame
    engine: str  # names of engine and device


class Explainer(PlannedCampaign):
    """Explains runs of one campaign."""

    def __init__(self, config: CampaignConfig, engine: str = "auto"):
        """Raises UserError if the campaign, its robot or the engine does not support this."""
        if not config.robot.seams:
            raise UserError(
                f"robot {config.campaign.robot!r} declares no seams at which its runs could be"
                " compared. The time series of single runs are available with `ravenjax trace`"
            )
        engines = [name for name, properties in selection.ENGINES.items() if properties.explains]
        if engine != "auto" and engine not in engines:
            raise UserError(
                f"engine {engine!r} cannot explain runs: expected auto or {', '.join(engines)},"
                " which compare every number of a tick bit by bit. If another engine computed the"
                f" result, write --engine simd{suggest_name(engine, engines)}"
            )
        super().__init__(config, engine)
        # This program also compares each seam with the golden run.
        program = explain_program(self.plan.program, config.robot)
        self._plan = dataclasses.replace(self.plan, program=program)

    def faulty(self) -> np.ndarray:
        """Indices of the runs with a fault."""
        return np.flatnonzero((self.plan.faults["code"] != 0).any(axis=1))

    def explain(
        self, rows: Sequence[int] | np.ndarray, on_progress: OnProgress | None = None
    ) -> Explained:
        """Compute these rows of the fault table again, and return their results and seam times.
        Raises UserError for no rows, or for more than MOST.
        """
        if not len(rows):
            raise UserError("no run to explain: expected runs with a fault")
        if len(rows) > MOST:
            raise UserError(
                f"{len(rows)} runs are too many to explain together, expected {MOST} at most: "
                "select one group with --group, or the worst runs with --worst"
            )
        plan = self._plan.take(np.asarray(rows))
        # Number only the golden runs of these rows, from 0.
        golden_runs = np.unique(plan.golden, return_inverse=True)[1]
        plan = dataclasses.replace(plan, golden=golden_runs.astype(np.int32))
        progress = Progress(self.engine, plan.runs, plan.runs, plan.program.ticks, on_progress)
        computed, golden = Computation(plan, self.backend, progress).tables([range(plan.runs)])
        progress.status.done = plan.runs
        progress.tell("done")
        # Outcomes that explain_program adds are no columns of the result table.
        added = [name for name in computed if name == HARM or name.startswith(PREFIXES)]
        observed = {name: computed.pop(name) for name in added}
        results = pd.DataFrame(outcomes.result_columns(self.config, plan.rows, computed, golden))
        index = np.asarray(rows, np.int32)
        ticks = pd.DataFrame({"run_id": results["run_id"], "index": index, **observed})
        return Explained(results, ticks, self.engine)

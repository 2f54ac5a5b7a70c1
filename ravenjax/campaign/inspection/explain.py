"""Computes many runs again, each compared with its golden run at every seam of the tick.

The robot's module adds the comparison to the tick (`prepared`, function `explained`). Runs are then
computed like any campaign. Ten thousand runs of 3 s take seconds on two cores.
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
from ravenjax.errors import UserError, suggest_name

ENGINES = ("simd", "xla", "cuda")
"""Engines whose runs can be compared bit by bit.

They compute links by single numbers, like the other parts of the tick.
"""
MOST = 200_000
"""Largest number of runs that are explained together: their ticks take a gigabyte."""
PREFIXES = ("differs:", "leaves:", "near:", "golden_near:", "near_ms:")
HARM = "harm_ms"
"""Names of the columns that the observer adds to a run's outcomes."""


class Explained(NamedTuple):
    """Explained runs, one row each in both tables, in the order in which they were given."""

    # Their rows of the result table, computed again.
    results: pd.DataFrame
    # Columns run_id, index, harm_ms; for each number differs: and leaves:, ms; for each check near:
    # and similar ones.
    ticks: pd.DataFrame
    engine: str  # engine and device, in words


class Explainer(PlannedCampaign):
    """Explains runs of one campaign."""

    def __init__(self, config: CampaignConfig, engine: str = "auto") -> None:
        """Raises UserError if the campaign, its robot or the engine does not support this."""
        part = config.robot.part("campaign")
        if not hasattr(part, "explained"):
            raise UserError(
                f"robot {config.campaign.robot!r} declares no seams, so its runs cannot be"
                " explained: expected a robot whose part `campaign` has `explained`, as raven2;"
                " look at single runs with `ravenjax trace`"
            )
        if engine != "auto" and engine not in ENGINES:
            raise UserError(
                f"engine {engine!r} cannot explain runs: expected auto or {', '.join(ENGINES)},"
                " which compare every number of the tick bit by bit; for a result of another engine"
                f" write --engine simd{suggest_name(engine, ENGINES)}"
            )
        super().__init__(config, engine)
        self._plan = dataclasses.replace(self.plan, program=part.explained(self.plan.program))

    def faulty(self) -> np.ndarray:
        """Indices of the runs with a fault."""
        return np.flatnonzero((self.plan.faults["code"] != 0).any(axis=1))

    def explain(
        self, rows: Sequence[int] | np.ndarray, on_progress: OnProgress | None = None
    ) -> Explained:
        """Compute these rows of the fault table again.

        Raises UserError for no rows, or for more than MOST.
        """
        if not len(rows):
            raise UserError("no run to explain: expected runs with a fault")
        if len(rows) > MOST:
            raise UserError(
                f"{len(rows)} runs are too many to explain together, expected {MOST} at most: "
                "take a group of them with --group, or the worst with --worst"
            )
        some = self._plan.take(np.asarray(rows))
        golden_runs = np.unique(some.golden, return_inverse=True)[1]
        some = dataclasses.replace(some, golden=golden_runs.astype(np.int32))
        progress = Progress(self.engine, some.runs, some.runs, some.program.ticks, on_progress)
        work = Computation(some, self.backend, progress)
        work.compile()
        own, golden = work.tables([range(some.runs)])
        progress.status.done = some.runs
        progress.tell("done")
        observed = {
            name: own.pop(name) for name in list(own) if name == HARM or name.startswith(PREFIXES)
        }
        results = pd.DataFrame(outcomes.result_columns(self.config, some.rows, own, golden))
        ticks = pd.DataFrame(
            {"run_id": results["run_id"], "index": np.asarray(rows, np.int32), **observed}
        )
        return Explained(results, ticks, self.engine)

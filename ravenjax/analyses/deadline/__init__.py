"""Finds the point of no return of a fault: the last tick in which an action prevents harm."""

from pathlib import Path

import pandas as pd

from ravenjax.store import manifest
from ravenjax.store.access import explained


def read_deadlines(directory: Path) -> pd.DataFrame | None:
    """Return the table of `ravenjax deadline` in a result folder, or None if it was not computed.

    The table has a row for each harmful fault and each action:

    run, action    run id; name of the action
    deadline_ms    last time at which the action prevents the harm, ms after the fault's first
                   effect; negative: before the effect, so that the harm cannot be prevented
    effect_ms      time of the fault's first effect, ms since the run began
    visible_ms     first time at which a signal shows the fault, ms after its first effect; NaN if
                   no signal shows the fault
    margin_ms      deadline_ms minus visible_ms; NaN if no signal shows the fault
    monotone       False if an action at an earlier tried tick does not prevent the harm
    harms_alone    True if the action also causes harm without the fault

    Raise StoreError for a folder without results, and for a damaged table.
    """
    record = manifest.read_manifest(directory)
    return explained.read_rows(directory / explained.DEADLINES, record, "deadline")

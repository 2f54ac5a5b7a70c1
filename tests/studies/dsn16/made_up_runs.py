"""Runs of the targeted attacks without simulation: made-up result tables of a small grid."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from ravenjax.campaign import loading
from studies.dsn16 import attacks
from studies.dsn16.attacks import DURATIONS, VariantRuns

ONSETS = range(1000, 2000, 100)
VALUES = (100, 1000, 10000, 40000)


def table(jumps: Mapping[tuple[float, int], int]) -> pd.DataFrame:
    """A result table of ten onsets a cell, of which so many jump, and a fault-free run; a jump
    is ten packets late.
    """
    cells = [(v, d) for v in VALUES for d in DURATIONS]
    rows = [(v, d, t1, k < jumps.get((v, d), 0)) for v, d in cells for k, t1 in enumerate(ONSETS)]
    value, duration, start, jump = (np.array(column) for column in zip(*rows, strict=True))
    faulty = pd.DataFrame(
        {
            "index": np.arange(len(rows)) + 1,
            "group": "scenario_b",
            "failed": "",
            "response": np.where(value >= 40000, "stopped", "silent"),
            "jump_code": jump,
            "jump_code_first_ms": np.where(jump, start + 11, -1),
            "first_active_ms": start - 1,
            "check_ik_reject_count": np.where(value >= 10000, 3, 1),
            "fault0_site": "usb_out",
            "fault0_value": value.astype(float),
            "fault0_start_ms": start,
            "fault0_duration_ms": duration,
        }
    )
    free = faulty.iloc[:1].assign(
        index=0,
        group="fault_free",
        response="silent",
        jump_code=False,
        jump_code_first_ms=-1,
        check_ik_reject_count=1,
    )
    return pd.concat([free.assign(fault0_site="", fault0_value=np.nan), faulty.iloc[::-1]])


def runs_of(jumps: Mapping[tuple[float, int], int], name: str = "made_up") -> VariantRuns:
    """The runs of such a table."""
    return attacks.runs_of(name, loading.load_campaign("dsn16_b.toml"), table(jumps))

"""`ravenjax monitor operate`: fresh fault-free operations for a monitor, of the same robots or
of others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from ravenjax.analyses.monitors import calibration, score_folder, writing
from ravenjax.analyses.monitors.calibrate import OnOperator, operate
from ravenjax.analyses.monitors.operations import FRESH, OperationDesign
from ravenjax.analyses.monitors.score_folder import Peaks
from ravenjax.campaign import loading
from ravenjax.errors import UserError


def fresh(
    folder: Path,
    out: Path,
    hours: float,
    overrides: Sequence[str] = (),
    robots: int | None = None,
    engine: str = "auto",
    on_operator: OnOperator = lambda *_: None,
) -> Peaks:
    """Operations in `out` of operators that the calibration in `folder` never had, measured as
    there.

    overrides: `key.path=value` of the campaign, as `parameters.plant.friction_scale=4`. robots: of
    each operator; default the calibration's. Finished operators stay, and the same call goes on.
    Raises UserError and StoreError.
    """
    calibration.require_hours(hours)
    monitor, _ = writing.read(folder)
    record = score_folder.read_design(folder / score_folder.FOLDER)
    campaign, design = record["campaign"], record["design"]
    raw = campaign | {
        "campaign": campaign["campaign"] | {"name": "fresh"},
        "group": [{"name": "fresh"}],
    }
    config = loading.from_dict(raw, overrides=overrides)
    own = OperationDesign(
        tuple(design["motions"]),
        robots or design["robots"],
        design["length_s"],
        design["seed"],
        FRESH,
    )
    units = round(hours * 3600 / (own.robots * own.length_s))
    if units < 1:
        raise UserError(
            f"--hours {hours:g}: less than one operator with {own.robots} operations of"
            f" {own.length_s:g} s each, {own.robots * own.length_s / 3600:.3g} h"
        )
    wanted = tuple(dataclasses.replace(term, scales=(1.0,)) for term in monitor.terms)
    return operate(config, own, wanted, monitor.segments, out, units, engine, on_operator)

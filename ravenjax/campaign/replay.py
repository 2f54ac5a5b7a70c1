"""One run again, alone, with everything that crossed the seams of the tick as time series."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import compile_cache, outcomes, plan, run_id
from ravenjax.campaign.config import CampaignConfig
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError
from ravenjax.store import manifest
from ravenjax.types import Setup

LANES = 16
"""Lanes of a replay's block: one vector, so that the run takes the same vector code as in its campaign."""


@dataclasses.dataclass(frozen=True, eq=False)
class Replay:
    """What a replay gives."""

    row: pd.Series  # the run's row of the result table, computed anew
    series: dict[str, np.ndarray]  # name -> [ticks] or [ticks, k], see `series`
    tick_s: float = 1e-3


def replay(config: CampaignConfig, run: str | int, engine: str = "auto") -> Replay:
    """Run one row of a campaign: `run` is its run id (or the beginning of one that no other has) or its index."""
    compile_cache.enable()
    ready = plan.make(config)
    row = find(ready.table["run_id"].to_numpy(), run)
    varied, harmless = ready.lanes([row], LANES, harmless=True)
    _, faults = ready.lanes([row], LANES)
    twin = Block(varied, harmless, None)
    chosen = selection.select(engine, ready.program.setup.precision, compile_cache.objects())
    own, result, signals = chosen.trace(ready.program, twin, Block(varied, faults, None), ready.columns)
    found, fault_free = ({name: values[:1] for name, values in one.outcomes.items()} for one in (result, own))
    frame = outcomes.frame(config, ready.table.iloc[row : row + 1], found, fault_free)
    setup = ready.program.setup
    twin_tips = {
        f"{arm}/twin_tip": np.asarray(own.reference)[:, 6 * i : 6 * i + 3, 0] for i, arm in enumerate(setup.arms)
    }
    return Replay(frame.iloc[0], series(setup, signals) | twin_tips)


def from_folder(folder: Path, run: str | int, engine: str = "auto") -> Replay:
    """Run one row of the campaign that a result folder holds, on the engine that it was computed with if "auto"."""
    record = manifest.read(folder)
    config = CampaignConfig.model_validate(record.config)
    if engine == "auto":
        # A GPU's results come again on a CPU, to the bit where that fuses multiply-adds.
        engine = "auto" if record.engine == "cuda" else record.engine
    return replay(config, run, engine)


def find(ids: np.ndarray, run: str | int) -> int:
    """Index of a run by id, beginning of an id, or index; `ids` as in the fault table. Raises UserError."""
    if isinstance(run, int) or (run.isdecimal() and len(run) < run_id.DIGITS):
        index = int(run)
        if not 0 <= index < len(ids):
            raise UserError(f"run {index}: the campaign has runs 0..{len(ids) - 1}")
        return index
    matches = run_id.beginning(ids, run)
    if len(matches) != 1:
        problem = "no run has this id" if not len(matches) else f"{len(matches)} runs begin so"
        raise UserError(f"run {run!r}: {problem}; expected a run_id of the result table")
    return int(matches[0])


def series(setup: Setup, signals: Any) -> dict[str, np.ndarray]:
    """Named time series of a run's signals, SI units but for a suffix; arms are prefixes.

    measured and desired values are those of the control software, `tip` and `link_jpos` the truth of the virtual robot.
    """
    control = signals.control
    out: dict[str, np.ndarray] = {
        "runlevel": control.runlevel,
        "surgeon_mode": control.surgeon_mode,
        "last_seq": control.last_seq,
        "soft_estopped": control.soft_estopped,
        "pins_out": control.pins_out,
        "plc_runlevel": signals.plc.runlevel,
        "brakes": signals.plc.brakes,
        "packet_received": signals.packet.received,
    }
    for slot, active in enumerate(signals.fault_active):
        out[f"fault{slot}_active"] = active
    if len(setup.arms) > 1:
        out["tip_distance_mm"] = signals.tip_distance * 1e3
    for i, arm in enumerate(setup.arms):
        out |= {f"{arm}/{name}": values for name, values in _arm(signals, i).items()}
    return {name: np.asarray(values) for name, values in out.items()}


def _arm(signals: Any, i: int) -> dict[str, np.ndarray]:
    software, plant = signals.control.arms[i], signals.plant[i]
    model, cue = signals.nominal[i], signals.haptics[i]
    direction = _stack(cue.direction)
    return {
        "enc_val_cnt": _stack(software.enc_val),
        "mpos": _stack(software.mpos),
        "mvel": _stack(software.mvel),
        "jpos": _stack(software.jpos),
        "jvel": _stack(software.jvel),
        "jpos_d": _stack(software.jpos_d),
        "mpos_d": _stack(software.mpos_d),
        "tau_d": _stack(software.tau_d),
        "current_cmd_cnt": _stack(software.current_cmd),
        "dac_cnt": _stack(software.current_cmd_written),
        "position": _stack(software.pos.position_um) * 1e-6,
        "rotation": np.stack([_stack(row) for row in software.pos.rotation], axis=1),
        "position_d": _stack(software.pos_d.position_um) * 1e-6,
        "rotation_d": np.stack([_stack(row) for row in software.pos_d.rotation], axis=1),
        "link_jpos": _stack(plant.jpos),
        "link_jvel": _stack(plant.jvel),
        "motor_mpos": _stack(plant.mpos),
        "motor_mvel": _stack(plant.mvel),
        "cable_tension": _stack(plant.tension),
        "tip": _stack(signals.tip[i]),
        "model_position": _stack(model.tip_position),
        "model_jpos": _stack(model.jpos),
        "tip_error_mm": np.asarray(cue.distance) * 1e3,
        "haptic_force": direction * np.asarray(cue.force[0])[:, None],
        "cue_force": _stack(cue.force),
        "tissue_depth_mm": np.asarray(signals.depth[i]) * 1e3,
    }


def _stack(numbers: Any) -> np.ndarray:
    return np.stack([np.asarray(x) for x in numbers], axis=-1)

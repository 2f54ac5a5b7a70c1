"""One run again, alone, with everything that crossed the seams of the tick as time series."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.campaign import compile_cache, outcomes, plan
from ravenjax.campaign.faults import run_id
from ravenjax.campaign.file.config import CampaignConfig, validated
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError
from ravenjax.numbers.setup import Setup
from ravenjax.robots.raven2.geometry import scene
from ravenjax.robots.raven2.geometry.links import jaw_rotation
from ravenjax.store import manifest
from ravenjax.store.logs.trace_log import Base

LANES = 16
"""Lanes of a replay's block: one vector, so that the run takes the same vector code as in its campaign."""


@dataclasses.dataclass(frozen=True, eq=False)
class Replay:
    """One run, computed again."""

    row: pd.Series  # the run's row of the result table, computed anew
    series: dict[str, np.ndarray]  # name -> [ticks] or [ticks, ...], those of `ravenjax.store.logs.time_series`
    golden: dict[str, Any]  # the golden run's outcomes, as the engine counts them
    bases: dict[str, Base]  # of each arm, in the world
    engine: str  # engine and device, in words


class Replayer:
    """Runs rows of one campaign again, one after the other: planned and compiled once."""

    def __init__(self, config: CampaignConfig, engine: str = "auto") -> None:
        """Raises UserError for a campaign or an engine that cannot be run."""
        compile_cache.enable()
        self.config = config
        self._plan = plan.make(config)
        self._ids = self._plan.table["run_id"].to_numpy()
        program = self._plan.program
        chosen = selection.select(engine, program.setup.precision, compile_cache.objects())
        self.engine = f"{chosen.name} on {chosen.device}"
        self._tracer = chosen.tracer(program, LANES)
        self._bases = {arm: Base(*scene.base_pose(arm)) for arm in program.setup.arms}

    @staticmethod
    def of_folder(folder: Path, engine: str = "auto") -> Replayer:
        """Of the campaign that a result folder holds, on the engine that computed it if "auto".

        Raises StoreError as `manifest.read`, and UserError.
        """
        record = manifest.read(folder)
        if engine == "auto":
            # A GPU's results come again on a CPU, to the bit where that fuses multiply-adds.
            engine = "auto" if record.engine == "cuda" else record.engine
        return Replayer(validated(record.config), engine)

    def index(self, run: str | int) -> int:
        """Index of a run by its id, the beginning of its id, or its index. Raises UserError."""
        return find(self._ids, run)

    def replay(self, run: str | int) -> Replay:
        """Run one row; `run` as for `index`. Raises UserError."""
        row, program = self.index(run), self._plan.program
        varied, harmless = self._plan.lanes([row], LANES, harmless=True)
        _, faults = self._plan.lanes([row], LANES)
        golden, result, signals = self._tracer.run(
            Block(varied, harmless, None), Block(varied, faults, None), self._plan.columns
        )
        own, fault_free = ({name: values[:1] for name, values in one.outcomes.items()} for one in (result, golden))
        frame = outcomes.frame(self.config, self._plan.table.iloc[row : row + 1], own, fault_free)
        return Replay(
            row=frame.iloc[0],
            series=series(program.setup, signals) | _golden_tips(program.setup, golden.reference),
            golden={name: values[0].item() for name, values in fault_free.items()},
            bases=self._bases,
            engine=self.engine,
        )


def replay(config: CampaignConfig, run: str | int, engine: str = "auto") -> Replay:
    """Run one row of a campaign: `run` is its run id (or the beginning of one that no other has) or its index."""
    return Replayer(config, engine).replay(run)


def _golden_tips(setup: Setup, reference: np.ndarray) -> dict[str, np.ndarray]:
    """The golden run's tips [ticks, 3] from its reference series [ticks, series, lanes]."""
    tips = np.asarray(reference)[:, :, 0].reshape(len(reference), len(setup.arms), 2, 3)
    return {f"{arm}/golden_tip": tips[:, i, 0] for i, arm in enumerate(setup.arms)}


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
    """The time series of a run from its signals; names, axes, units and meanings in `store.logs.time_series`."""
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
        out |= {f"{arm}/{name}": values for name, values in _arm(signals, i, arm).items()}
    return {name: np.asarray(values) for name, values in out.items()}


def _arm(signals: Any, i: int, arm: str) -> dict[str, np.ndarray]:
    software, plant = signals.control.arms[i], signals.plant[i]
    model, cue = signals.nominal[i], signals.haptics[i]
    direction, link_jpos, model_jpos = _stack(cue.direction), _stack(plant.jpos), _stack(model.jpos)
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
        "link_jpos": link_jpos,
        "link_jvel": _stack(plant.jvel),
        "motor_mpos": _stack(plant.mpos),
        "motor_mvel": _stack(plant.mvel),
        "cable_tension": _stack(plant.tension),
        "tip": _stack(signals.tip[i]),
        "tip_rotation": jaw_rotation(arm, link_jpos),
        "model_position": _stack(model.tip_position),
        "model_rotation": jaw_rotation(arm, model_jpos),
        "model_jpos": model_jpos,
        "tip_error_mm": np.asarray(cue.distance) * 1e3,
        "haptic_force": direction * np.asarray(cue.force[0])[:, None],
        "cue_force": _stack(cue.force),
        "tissue_depth_mm": np.asarray(signals.depth[i]) * 1e3,
    }


def _stack(numbers: Any) -> np.ndarray:
    return np.stack([np.asarray(x) for x in numbers], axis=-1)

"""A made-up but plausible result table and manifest, so that store and report can be tested
without a simulation.
"""

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.store import parts, schema
from ravenjax.store.folder import ResultFolder
from ravenjax.store.manifest import CueRecord, DetectorRecord, Manifest, config_hash

CHECKS = (
    "overdrive_instant",
    "overdrive_clip",
    "estop",
    "ik_reject",
    "joint_limit",
    "master_timeout",
    "packet_order",
)
CUES = tuple(
    CueRecord(threshold_mm=t, kp_per_mm=k, cap=0.05)
    for t in (3.0, 1.0, 2.0, 5.0)
    for k in (0.0045, 0.009)
)

DETECTORS = (
    DetectorRecord("dsn16", "steps", "all", 1, (0.5, 1.0, 2.0)),
    DetectorRecord("tip", "tip_error", "all", 1, (3.0,)),
)

# group: site, effect, magnitudes (site's unit), share of runs, tip motion (mm per unit and 100 ms),
# chance of response
BLOCKS = {
    "dac_before_checks": ("dac", "overwrite", (-20000, 20000), 0.22, 2.4e-4, 0.75),
    "dac_after_checks": ("usb_out", "overwrite", (-20000, 20000), 0.22, 2.4e-4, 0.25),
    "shoulder_feedback": ("mpos", "offset", (-3.0, 3.0), 0.16, 1.2, 0.35),
    "packet_position": ("packet", "latch_offset", (-8000, 8000), 0.16, 6e-4, 0.2),
    "encoder": ("encoder", "bit_flip", (0, 15), 0.12, 0.5, 0.5),
    "plc_pins": ("plc", "toggle", (np.nan, np.nan), 0.08, 0.0, 0.9),
}
CHANNELS = ("shoulder", "elbow", "insertion")


def shape(arms: tuple[str, ...] = ("gold",), cues: int = len(CUES)) -> schema.Shape:
    """The made-up campaign's shape: one slot, one varied parameter, two detectors."""
    return schema.Shape(
        arms=arms,
        slots=1,
        cues=cues,
        checks=CHECKS,
        parameters=("plant.friction_scale",),
        detectors=tuple(len(detector.thresholds) for detector in DETECTORS),
    )


def frame(runs: int = 2000, seed: int = 0, form: schema.Shape | None = None) -> pd.DataFrame:
    """`runs` rows that fit `shape()`; the last 2 % carry no fault, a few have failed."""
    form = form or shape()
    random = np.random.default_rng(seed)
    share = np.array([block[3] for block in BLOCKS.values()])
    names = np.array([*BLOCKS])
    group = random.choice(names, size=runs, p=share / share.sum()).astype(object)
    free = np.arange(runs) >= runs - max(1, runs // 50)
    group[free] = "fault_free"
    low, high = np.array([BLOCKS.get(g, (0, 0, (np.nan, np.nan)))[2] for g in group], float).T
    value = low + (high - low) * random.random(runs)
    value = np.where(group == "encoder", np.round(value), value)
    start = np.where(free, 0, random.integers(200, 2400, runs))
    duration = np.where(free, 0, np.round(2.0 ** random.uniform(0, 9, runs)).astype(int))
    reach = np.array([BLOCKS.get(g, (0, 0, 0, 0, 0.0, 0.0))[4] for g in group])
    push = reach * np.abs(np.nan_to_num(value)) * duration / 100 * random.lognormal(0, 0.5, runs)
    deviation = 0.9 + random.gamma(2, 0.3, runs) + 14 * np.tanh(push / 14)
    chance = np.array([BLOCKS.get(g, (0, 0, 0, 0, 0, 0.0))[5] for g in group])
    trips = random.random(runs) < chance * (1 - np.exp(-duration / 60))
    stopped = trips & (random.random(runs) < 0.8)
    activated = ~free & (random.random(runs) < 1.0)
    dac = np.char.startswith(group.astype(str), "dac")
    limited = trips & ~stopped & dac  # a clipped command
    cause = np.where(dac, "overdrive", "joint_limit")
    cause = np.where(limited, "overdrive_clip", cause)
    cause = np.where(
        group == "packet_position", "ik_reject", np.where(group == "plc_pins", "plc", cause)
    )
    failed = np.where(random.random(runs) < 0.003, "model tip not finite", "")
    failed = failed.astype(object)
    step = deviation * random.uniform(0.02, 0.12, runs)
    told_ms = start + 5 + random.exponential(60, runs).astype(int)
    lost = random.random(runs) < np.where(
        group == "plc_pins", 0.5, 0.1
    )  # what was off course stood still
    unintended = np.where(lost | free, 0.3, np.maximum(deviation - 1, 0))
    loss = np.where(lost & ~free, np.maximum(deviation - 1, 0), np.minimum(unintended, 2.9))
    report = np.where(group == "encoder", np.maximum(6 - deviation, 0), 0.01)
    halted = np.where(lost & (random.random(runs) < 0.2), 500, 4)
    columns: dict[str, object] = {
        "run_id": [hashlib.sha256(f"{seed}/{i}".encode()).hexdigest()[:16] for i in range(runs)],
        "index": np.arange(runs),
        "pair": np.arange(runs),
        "group": group,
        "seed": np.full(runs, 7),
        "operator": random.choice(["suturing", "circle"], runs),
        "fault0_site": [BLOCKS[g][0] if g in BLOCKS else "" for g in group],
        "fault0_arm": np.where(free, "", "gold"),
        "fault0_channel": np.where(free, "", random.choice(CHANNELS, runs)),
        "fault0_effect": [BLOCKS[g][1] if g in BLOCKS else "" for g in group],
        "fault0_value": value,
        "fault0_trigger": np.where(free, "", "time"),
        "fault0_start_ms": start,
        "fault0_duration_ms": duration,
        "fault0_every_ms": np.zeros(runs, int),
        "fault0_period_ms": np.zeros(runs, int),
        "param:plant.friction_scale": random.uniform(0.8, 1.2, runs),
        "applied0_first_ms": np.where(activated, start, -1),
        "applied0_last_ms": np.where(activated, start + duration - 1, -1),
        "applied0_ticks": np.where(activated, duration, 0),
        "activated": activated,
        "first_active_ms": np.where(activated, start, -1),
        "active_ticks": np.where(activated, duration, 0),
        "end_runlevel": np.where(stopped, 0, 3),
        "pedal_down_ms": np.where(stopped, start, 2800),
        "restart_ms": np.where(stopped & (np.arange(runs) % 9 == 0), 2800, -1),
        "diverged": activated,
        "response": np.select(
            [stopped, limited, trips], ["stopped", "limited", "flagged"], "silent"
        ),
        "response_cause": np.where(trips, cause, ""),
        "response_ms": np.where(trips, told_ms, -1),
        "told_ms": np.where(trips & ~limited, told_ms, -1),
    }
    for check in form.checks:
        hit = trips & (cause == check.removesuffix("_instant"))
        columns[f"check_{check}_first_ms"] = np.where(hit, columns["response_ms"], -1)
        columns[f"check_{check}_count"] = hit * 3
        columns[f"check_{check}_margin"] = random.normal(0, 1, runs)
    for k in range(form.cues):
        cue = CUES[k]
        felt = deviation > cue.threshold_mm
        delay = 40 + 160 * cue.threshold_mm / np.maximum(deviation, 1) * random.uniform(
            0.5, 1.5, runs
        )
        columns[f"cue{k}_first_ms"] = np.where(felt, start + delay.astype(int), -1)
        columns[f"cue{k}_peak_force"] = np.where(
            felt, np.minimum(cue.cap or 1.0, cue.kp_per_mm * deviation), 0
        )
        columns[f"cue{k}_ms"] = np.where(felt, duration + 50, 0)
        columns[f"cue{k}_count"] = felt * 1
    scores = {"steps": deviation * random.lognormal(-1.0, 0.6, runs), "tip_error": deviation}
    for d, (detector, thresholds) in enumerate(zip(DETECTORS, form.detectors, strict=False)):
        score = scores[detector.kind]
        columns[f"detector{d}_score"] = score
        for k in range(thresholds):
            over = score > detector.thresholds[k]
            columns[f"detector{d}_threshold{k}_first_ms"] = np.where(over, start + 30, -1)
            columns[f"detector{d}_threshold{k}_alarms"] = over * 1
    columns |= {
        "peak_model_deviation_mm": deviation,
        "peak_live_deviation_mm": deviation,
        "rms_model_deviation_mm": deviation * 0.4,
        "peak_golden_deviation_mm": np.maximum(deviation - 1, 0),
        "rms_golden_deviation_mm": deviation * 0.3,
        "largest_step_mm": step,
        "tip_path_mm": 30 + push,
        "unintended_mm": unintended,
        "unintended_first_ms": np.where(unintended > LIMIT_MM, start + 60, -1),
        "unintended_off_mm": np.where(stopped, np.maximum(deviation - 2, 0), 0),
        "loss_mm": loss,
        "loss_first_ms": np.where(loss > LIMIT_MM, start + 90, -1),
        "false_report_mm": report,
        "false_report_first_ms": np.where(report > LIMIT_MM, start + 15, -1),
        "halted_ms": halted,
        "jump_code": step > 0.1,
        "jump_code_first_ms": np.where(step > 0.1, start + 10, -1),
        "jump_tip": step > 0.1,
        "jump_tip_first_ms": np.where(step > 0.1, start + 10, -1),
        "idle_ms": np.where(stopped, 2000, 0),
        "jump_text": step > 0.5,
        "jump_text_first_ms": np.where(step > 0.5, start + 10, -1),
        "tissue_depth_mm": np.maximum(deviation - 6, 0),
        "tip_distance_mm": np.full(runs, np.nan),
        "failed": failed,
        "failed_first_ms": np.where(failed == "", -1, 7),
    }
    quiet = {
        "cue": -1,
        "detector": 0.4,
        "tip_path_mm": 30.0,
        "pedal_down_ms": 2800,
        "restart_ms": -1,
        "halted_ms": 4,
        "peak_live": 1.0,
    }
    for column in schema.table_columns(form):
        if column.name.startswith(schema.GOLDEN):
            plain = column.name.removeprefix(schema.GOLDEN)
            value = next((v for name, v in quiet.items() if plain.startswith(name)), 0)
            if plain.startswith("check_") and plain.endswith("_first_ms"):
                value = -1
            columns[column.name] = np.full(runs, value)
    for arm in form.arms:
        for joint in form.joints:
            columns[f"peak_dac_{arm}_{joint}"] = random.integers(500, 20000, runs)
    table = pd.DataFrame(columns)
    return judged(table)


def judged(table: pd.DataFrame, cue: int = 0) -> pd.DataFrame:
    """A table whose hazard and verdict follow from its other columns, written out row by row."""
    hazard, verdict = [], []
    for row in table.to_dict("records"):
        halted = row["halted_ms"] - row["golden_halted_ms"] > 200 and row["response"] != "stopped"
        if row["unintended_first_ms"] >= 0:
            hazard.append("unintended motion")
        elif row["loss_first_ms"] >= 0 or halted:
            hazard.append("loss of motion")
        else:
            hazard.append("false report" if row["false_report_first_ms"] >= 0 else "none")
        own, golden = row[f"cue{cue}_first_ms"], row[f"golden_cue{cue}_first_ms"]
        came = own >= 0 and not 0 <= golden <= own
        verdict.append(
            "" if row["failed"] else f"{row['response']}/{hazard[-1]}/{'cue' if came else 'no cue'}"
        )
    return table.assign(hazard=hazard, verdict=verdict)


def manifest(runs: int = 2000, **changes: object) -> Manifest:
    """The made-up campaign's manifest, without parts."""
    config = {
        "name": "synthetic",
        "seed": 7,
        "duration_s": 3.0,
        "operator": {"name": "suturing", "scale": 0.1},
    }
    fields = {
        "campaign": "synthetic",
        "config": config,
        "config_hash": config_hash(config),
        "seed": 7,
        "runs": runs,
        "duration_ms": 3000,
        "shape": shape(),
        "cues": CUES,
        "detectors": DETECTORS,
        "engine": "xla",
        "device": "2 cores of a made-up processor",
        "code_hash": "0123456789abcdef" * 4,
    }
    return Manifest.model_validate(fields | changes)


def folder(place: Path, rows: pd.DataFrame, record: Manifest, chunk: int = 500) -> Path:
    """A finished result folder of these rows, in parts of so many."""
    results = ResultFolder.open(place, record)
    for span in results.missing(chunk):
        results.add(rows.iloc[span.start : span.stop])
    results.close(compile_s=1.0, run_s=1.0, rows=len(rows))
    return place


def write_part(folder: Path, columns, shape: schema.Shape, config_hash: str) -> parts.Part:
    """Rows as one part in a folder that need not have a manifest."""
    return parts.put_part(folder, parts.encode_part(columns, shape, config_hash))

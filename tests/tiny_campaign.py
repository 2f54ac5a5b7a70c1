"""A campaign of very short runs that takes no time, for tests of whatever carries it out."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

import ravenjax as rj
from ravenjax.store.folder import read_all


def fault(*own: Any, **more: Any) -> dict:
    """A table [[group.fault]] with site, channel, effect, value and start_ms, and further keys."""
    names = ("site", "channel", "effect", "value", "start_ms")
    return dict(zip(names, own, strict=True)) | more


def tables(runs: int = 300, chunk: int = 20, duration_s: float = 0.05) -> dict:
    """As a TOML file has them: some fault-free runs with three golden runs, and one group of
    random faults.
    """
    return {
        "campaign": {"name": "tiny", "duration_s": duration_s, "seed": 3, "chunk": chunk},
        "operator": {"motion": "reach"},
        "group": [
            {"name": "free", "parameters": {"plant.friction_scale": [0.7, 1.0, 1.4]}},
            {
                "name": "dac",
                "design": "random",
                "runs": runs - 3,
                "fault": [
                    {
                        "site": "usb_out",
                        "channel": ["shoulder", "elbow"],
                        "effect": "overwrite",
                        "value": {"uniform": [-9000, 9000]},
                        "start_ms": {"uniform": [5, 40]},
                        "duration_ms": {"uniform": [1, 10]},
                    }
                ],
            },
        ],
    }


def config(**sizes):
    """The campaign, validated."""
    return rj.load_campaign(tables(**sizes))


def file(folder: Path, **sizes) -> Path:
    """The campaign as a TOML file in `folder`."""
    made, path = tables(**sizes), folder / "tiny.toml"
    free, dac = made["group"]
    fault = "\n".join(f"{key} = {_toml(value)}" for key, value in dac["fault"][0].items())
    path.write_text(
        "[campaign]\n"
        + "\n".join(f"{key} = {_toml(value)}" for key, value in made["campaign"].items())
        + "\n"
        f'[operator]\nmotion = "reach"\n[[group]]\nname = "free"\n[group.parameters]\n'
        f"plant.friction_scale = {_toml(free['parameters']['plant.friction_scale'])}\n"
        '[[group]]\nname = "dac"\ndesign = "random"\nruns ='
        f" {dac['runs']}\n[[group.fault]]\n{fault}\n"
    )
    return path


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(inner)}" for key, inner in value.items()) + " }"
    return json.dumps(value)


def digest(table: pd.DataFrame | Path) -> str:
    """sha256 of every byte of a table, of a result folder's in the order of `index`."""
    frame = table if isinstance(table, pd.DataFrame) else read_all(table)
    assert frame["index"].is_monotonic_increasing and frame["run_id"].is_unique
    sink = pa.BufferOutputStream()
    arrow = pa.Table.from_pandas(frame, preserve_index=False).combine_chunks()
    with pa.ipc.new_stream(sink, arrow.schema) as writer:
        writer.write_table(arrow)
    return hashlib.sha256(sink.getvalue()).hexdigest()

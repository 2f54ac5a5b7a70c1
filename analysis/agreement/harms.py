"""Compares the harms of a campaign with rtamt, a library for signal temporal logic.

    pip install rtamt
    python analysis/agreement/harms.py [RUNS]

Runs the faults of harms.toml on engine simd, and evaluates each harm on the traces with rtamt's
monitor of discrete time. Prints for each harm the number of runs in which rtamt finds the same
first millisecond, and the largest difference of the margins. The first 130 ms are not compared,
because rtamt evaluates windows there that are not yet complete.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import rtamt

import ravenjax as rj
from ravenjax.campaign.inspection.replay import Replayer
from ravenjax.campaign.loading import load_campaign

CAMPAIGN = Path(__file__).with_name("harms.toml")
FILLED = 130
SIGNALS = ("from_golden", "from_model", "speed", "depth", "dac")


def signals(trace) -> dict[str, np.ndarray]:
    """Return the signals of a trace's only arm, [ticks]."""
    series = {name.removeprefix("gold/"): np.asarray(values) for name, values in trace.items()}
    tip = series["tip"]
    steps = np.diff(tip, axis=0, prepend=tip[:1])
    return {
        "from_golden": np.linalg.norm(tip - series["golden_tip"], axis=1) * 1e3,
        "from_model": np.linalg.norm(tip - series["model_position"], axis=1) * 1e3,
        "speed": np.linalg.norm(steps, axis=1) * 1e6,
        "depth": series["tissue_depth_mm"],
        "dac": np.abs(series["dac_cnt"]).max(axis=1),
    }


def monitor(text: str) -> rtamt.StlDiscreteTimeSpecification:
    """Return rtamt's monitor of an expression. `implies` is written as `not` and `or`."""
    spec = rtamt.StlDiscreteTimeSpecification()
    for name in (*SIGNALS, "out"):
        spec.declare_var(name, "float")
    if "implies(" in text:
        head, _, rest = text.partition("implies(")
        condition, _, consequence = rest.partition(", ")
        text = f"{head}((not ({condition})) or ({consequence})"
    spec.spec = f"out = {text}"
    spec.parse()
    spec.pastify()
    return spec


def main() -> None:
    """Print the agreement."""
    config = load_campaign(CAMPAIGN)
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else config.group[0].runs
    with tempfile.TemporaryDirectory() as folder:
        table = rj.run(CAMPAIGN, out=Path(folder) / "out", engine="simd")
    replayer = Replayer(config, "simd")
    specs = {one.name: monitor(one.when) for one in config.harm}
    found = {name: ([], []) for name in specs}
    for run in range(runs):
        seen = signals(replayer.replay(run).series)
        rows = np.column_stack([seen[name] for name in SIGNALS])
        for name, spec in specs.items():
            if run:
                spec.reset()
            values = np.array(
                [spec.update(t, list(zip(SIGNALS, row, strict=True))) for t, row in enumerate(rows)]
            )[FILLED:]
            found[name][0].append(-values.max())
            found[name][1].append(np.argmax(values > 0) + FILLED if (values > 0).any() else -1)
    print("| harm | runs with harm | same first ms | largest difference of the margins |")
    print("|---|---|---|---|")
    for name, (margin, first) in found.items():
        ours, ms = (table[f"harm_{name}_{key}"].to_numpy()[:runs] for key in ("margin", "first_ms"))
        apart = np.abs(ours - margin)
        same = (ms == np.array(first)).sum()
        print(f"| {name} | {(ms >= 0).sum()} | {same} of {runs} | {apart.max():.2g} |")


if __name__ == "__main__":
    main()

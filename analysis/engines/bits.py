"""Tests whether two engines give the same bits in whole campaigns. Prints a Markdown table, and
exits with 1 if they do not.

    python analysis/engines/bits.py quick gated.toml [--engines simd cuda] [--set KEY=VALUE]

Both engines run each campaign, which is bundled or a file. Every bit of every column of the result
table is compared. The last bits of engine xla differ. For this engine the table shows the runs in
which a verdict or another word differs, and the largest difference of an outcome in mm.
"""

import argparse
import sys
import time

import numpy as np
import pandas as pd

import ravenjax as rj


def unequal(one: pd.DataFrame, other: pd.DataFrame) -> list[str]:
    """Return columns that are not equal in every bit. NaN equals NaN of the same bits."""
    if list(one) != list(other) or len(one) != len(other):
        return ["columns or rows"]
    return [name for name in one if not _same(one[name].to_numpy(), other[name].to_numpy())]


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    if a.dtype != b.dtype:
        return False
    return a.tobytes() == b.tobytes() if a.dtype != object else a.tolist() == b.tolist()


def words(one: pd.DataFrame, other: pd.DataFrame) -> int:
    """Return the runs in which a column of words or booleans differs."""
    named = [name for name in one if one[name].dtype.kind not in "fiu"]
    return int((one[named].astype(str) != other[named].astype(str)).any(axis=1).sum())


def farthest(one: pd.DataFrame, other: pd.DataFrame) -> str:
    """Return the outcome in mm that differs most, and the difference."""
    apart = {
        name: float((one[name] - other[name]).abs().max()) for name in one if name.endswith("_mm")
    }
    name = max(apart, key=lambda key: np.nan_to_num(apart[key], nan=-1.0))
    return f"{apart[name]:.2g} mm in {name}"


def main() -> int:
    """Run both engines and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaigns", nargs="+")
    parser.add_argument("--engines", nargs=2, default=["simd", "cuda"])
    parser.add_argument("--set", nargs="*", default=[])
    options = parser.parse_args()
    first, second = options.engines
    print(
        f"| campaign | runs | columns | unequal | runs of other words | farthest | {first} |"
        f" {second} |"
    )
    print("|---" * 8 + "|")
    wrong = 0
    for name in options.campaigns:
        config = rj.load_campaign(name, options.set)
        tables, seconds = [], []
        for engine in options.engines:
            begin = time.perf_counter()
            tables.append(rj.run(config, engine=engine))
            seconds.append(f"{time.perf_counter() - begin:.1f} s")
        apart = unequal(*tables)
        wrong += bool(apart)
        runs, columns = tables[0].shape
        said = f"{len(apart)}: {', '.join(apart[:5])}" if apart else "0"
        more = f"{words(*tables)} | {farthest(*tables)}"
        cells = [" ".join([name, *options.set]), str(runs), str(columns), said, more, *seconds]
        print(f"| {' | '.join(cells)} |", flush=True)
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())

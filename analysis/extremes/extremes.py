"""Simulates thousands of random runs with extreme but allowed values. Reports crashes, invalid
result rows, and different verdicts of two engines.

    # 8 campaigns of 125 groups of 20 runs each: 20 008 runs
    python analysis/extremes/extremes.py 8 125
    # 15 forms of 20 groups of 67 runs at two sites: 20 115 runs
    python analysis/extremes/extremes.py 15:20 simd xla

If the verdicts of two engines differ, the script tests whether changes of last bits also change the
verdict of the first engine.
"""

import sys
import time
from collections.abc import Iterator, Sequence

import extreme_runs as extremes
import pandas as pd

import ravenjax as rj
from ravenjax.campaign.file.config import CampaignConfig


def drawn(first: str, *others: str) -> tuple[Iterator[tuple[int, CampaignConfig]], Sequence[str]]:
    """Return the campaigns that the command line selects, by number, and the engines."""
    if ":" not in first:
        groups, *engines = others
        return ((n, extremes.campaign(n, int(groups))) for n in range(int(first))), engines
    numbers, groups = first.split(":")
    start, end = numbers.split("-") if "-" in numbers else ("0", numbers)
    return ((n, extremes.form(n, int(groups))) for n in range(int(start), int(end))), others


def main(*words: str) -> int:
    """Run them, print the findings, and return the number of invalid rows."""
    campaigns, engines = drawn(*words)
    engines = engines or ("simd",)
    wrong = 0
    for number, config in campaigns:
        tables = []
        for engine in engines:
            began = time.perf_counter()
            table = rj.run(config, engine=engine)
            tables.append(table)
            causes = table.loc[table["failed"] != "", "failed"].astype(str).value_counts().to_dict()
            took = time.perf_counter() - began
            print(
                f"campaign {number}, {engine}: {len(table)} runs, {took:.0f} s, failed: {causes}",
                flush=True,
            )
            for line in extremes.unsound(table):
                wrong += 1
                print(f"  {line}")
        for other in tables[1:]:
            wrong += _compare(config, engines[0], tables[0], other)
    return wrong


def _compare(config: CampaignConfig, engine: str, first: pd.DataFrame, other: pd.DataFrame) -> int:
    """Print the differences between two engines, and return the number of differing runs that last
    bits do not decide.
    """
    apart = extremes.differences(first, other)
    if not apart:
        return 0
    decided = {
        one.run_id
        for table in extremes.nudged(config, engine)
        for one in extremes.differences(first, table)
    }
    runs = {one.run_id for one in apart}
    print(
        f"  apart: {len(runs)}, of these by last bits: {len(runs & decided)}; runs by last bits:"
        f" {len(decided)}"
    )
    for one in apart:
        by = "by last bits" if one.run_id in decided else "NOT BY LAST BITS"
        print(
            f"  {one.run_id} {one.group}: {one.column} {one.first!r} and {one.second!r}, {by}",
            flush=True,
        )
    return len(runs - decided)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]) > 0)

"""Thousands of random extreme but legal runs: crashes, rows that are not sound, verdicts of two engines.

python analysis/extremes/extremes.py 8 125             # campaigns and groups of 20 runs each: 20 008 runs
python analysis/extremes/extremes.py 8 125 simd xla    # the same beside a second engine, whose compiling takes minutes
"""

from __future__ import annotations

import sys

import ravenjax as rj
from ravenjax.bench import extremes


def main(campaigns: int, groups: int, *engines: str) -> int:
    """Run them, print what is found, and return the number of rows that are not as they must be."""
    wrong = 0
    for number in range(campaigns):
        config = extremes.campaign(number, groups)
        tables = [rj.run(config, engine=engine) for engine in engines or ("simd",)]
        for engine, table in zip(engines or ("simd",), tables, strict=True):
            causes = table.loc[table["failed"] != "", "failed"].astype(str).value_counts().to_dict()
            print(f"campaign {number}, {engine}: {len(table)} runs, failed: {causes}", flush=True)
            for line in extremes.unsound(table):
                wrong += 1
                print(f"  {line}")
        for other in tables[1:]:
            apart = extremes.differences(tables[0], other)
            wrong += len({one.run_id for one in apart})
            for one in apart:
                print(f"  {one.run_id} {one.group}: {one.column} {one.first!r} and {one.second!r}")
    return wrong


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:]) > 0)

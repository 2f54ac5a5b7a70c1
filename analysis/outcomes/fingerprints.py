"""Tests whether all bundled campaigns still give the same generated code and the same results.

    python analysis/outcomes/fingerprints.py                     # compare with fingerprints.json
    python analysis/outcomes/fingerprints.py --write             # write a new fingerprints.json
    python analysis/outcomes/fingerprints.py quick dsn16_a       # compare only these campaigns

Runs each campaign on engine simd and takes three SHA-256 hashes: of the generated LLVM IR, of the
CUDA C generated from the same program, and of the result table. Of a large campaign only the first
LIMIT runs are computed. Prints "equal" or the names of the hashes that differ.

The LLVM IR depends on the SIMD width of the CPU. fingerprints.json records the width it was made
with; on a CPU with another width the script skips the IR and compares the other two.
"""

import argparse
import hashlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any
from unittest import mock

os.environ["RAVENJAX_CACHE"] = "off"  # a cached kernel would not be generated

import pandas as pd

import ravenjax as rj
from ravenjax.engines.cpu import engine, jit
from ravenjax.engines.cpu.kernel import print_kernel
from ravenjax.engines.gpu.kernel import Form, print_loop
from ravenjax.ir.time_loop import split_lanes

FILE = Path(__file__).with_suffix(".json")
CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
LIMIT = 3000
"""Largest number of runs of a campaign: enough for every group, except in the sampling
campaigns.
"""


def fingerprint(name: str) -> dict[str, Any]:
    """Return hashes of the kernels and of the result table of one bundled campaign."""
    llvm_ir, cuda_c = set(), set()

    def split_and_hash(loop, shared, grouped):
        parts = split_lanes(loop, shared, grouped)
        cuda_c.add(sha256(print_loop(parts, Form(), grouped).text))
        return parts

    def print_and_hash(*arguments):
        kernel = print_kernel(*arguments)
        llvm_ir.add(sha256(kernel.text))
        return kernel

    with mock.patch.multiple(engine, split_lanes=split_and_hash, print_kernel=print_and_hash):
        table = rj.run(load(name), engine="simd")
    return {
        "runs": len(table),
        "llvm": sorted(llvm_ir),
        "cuda": sorted(cuda_c),
        "table": table_hash(table),
    }


def load(name: str) -> rj.CampaignConfig:
    """Return the campaign with a limit. A campaign that stops early ends at its first look
    instead.
    """
    stops = rj.load_campaign(name).stop is not None
    return rj.load_campaign(name, ["stop.looks=[0.01]" if stops else f"campaign.limit={LIMIT}"])


def table_hash(table: pd.DataFrame) -> str:
    """Return sha256 over the names, types and values of all columns."""
    digest = hashlib.sha256()
    for column in table:
        values = (
            table[column].astype(object)
            if table[column].dtype.kind not in "biuf"
            else table[column]
        )
        digest.update(f"{column} {values.dtype}\n".encode())
        plain = values.to_numpy()
        digest.update(
            "\0".join(map(str, plain)).encode() if plain.dtype == object else plain.tobytes()
        )
    return digest.hexdigest()[:16]


def sha256(text: str) -> str:
    """Return the first 16 digits of the sha256."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def main() -> int:
    """Compute, then compare or write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaigns", nargs="*")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    names = options.campaigns or sorted(path.stem for path in CAMPAIGNS.glob("*.toml"))
    kept = (
        json.loads(FILE.read_text())
        if FILE.is_file()
        else {"width": jit.host_target().width, "campaigns": {}}
    )
    compared = ["table", "cuda", *(["llvm"] if kept["width"] == jit.host_target().width else [])]
    different = 0
    for name in names:
        begin = time.perf_counter()
        found = fingerprint(name)
        expected = kept["campaigns"].get(name, {})
        changes = [key for key in compared if found[key] != expected.get(key)]
        different += bool(changes)
        seconds = time.perf_counter() - begin
        print(
            f"{name}: {found['runs']} runs, {seconds:.0f} s, {', '.join(changes) or 'equal'}",
            flush=True,
        )
        if options.write:
            kept["campaigns"][name] = found
    if options.write:
        FILE.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n")
        return 0
    return different > 0


if __name__ == "__main__":
    sys.exit(main())

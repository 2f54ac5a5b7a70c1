"""Golden results: computes them, compares with them, and replaces them when told to.

    python tests/golden/bless.py

rewrites results.csv beside this file from campaign.toml and prints what changed. Do so only for a
change of the simulation that is meant, and say in its commit why the numbers moved.

What must be equal, and what nearly: another CPU, or another version of XLA, may contract a product
and a sum into one rounding where this one does not. Verdicts, checks that trip, words and run ids
must be equal. Times of events may be off by TICKS_OFF, as a threshold may be crossed a tick
earlier; ticks counted likewise. Numbers that come out of float32 sums may be off by RELATIVE of
themselves plus ABSOLUTE in the column's unit: fifty times what engine mjx, which evaluates other
expressions of the link dynamics, is off in this campaign, and less than what 2 % of friction do to
any of its runs.
"""

from pathlib import Path

import numpy as np
import pandas as pd

import ravenjax as rj

FOLDER = Path(__file__).resolve().parent
CAMPAIGN = FOLDER / "campaign.toml"
RESULTS = FOLDER / "results.csv"
TICKS_OFF = 2
RELATIVE, ABSOLUTE = 5e-4, 5e-4
WHOLE_UM_OFF = (
    0.004  # mm; the reported tip is whole micrometres, so its error steps by one of each axis
)
DAC_OFF = 20  # counts; the command follows the encoders, of which one count is up to 8 DAC counts
FREE = ("index", "pair")  # where a run stands in its campaign is no result


def compute(overrides: tuple[str, ...] = (), engine: str = "xla") -> pd.DataFrame:
    """The results of the golden campaign by this code; the kept ones are those of the engine
    that prints nothing.
    """
    return rj.run(rj.load_campaign(CAMPAIGN, overrides), engine=engine)


def read() -> pd.DataFrame:
    """The golden results."""
    return pd.read_csv(RESULTS, keep_default_na=False, na_values=["nan"], dtype={"run_id": str})


def differences(found: pd.DataFrame, golden: pd.DataFrame) -> list[str]:
    """What is not as it should be: one line for each number, "" where all is well."""
    if list(found["run_id"]) != list(golden["run_id"]):
        return [f"run ids {list(found['run_id'])}, expected {list(golden['run_id'])}"]
    if set(found.columns) != set(golden.columns):
        return [f"columns that only one has: {sorted(set(found.columns) ^ set(golden.columns))}"]
    out = []
    for name in golden.columns.difference(FREE, sort=False):
        for row, (got, expected) in enumerate(
            zip(plain(found[name]), plain(golden[name]), strict=True)
        ):
            if not equal(name, got, expected):
                out.append(f"{golden['group'][row]}: {name} is {got}, expected {expected}")
    return out


def plain(column: pd.Series) -> list:
    """Text, truth values and numbers of a column as Python has them."""
    return column.astype(object).tolist()


def equal(name: str, got: object, expected: object) -> bool:
    """Whether a value is the golden one, as far as its column may differ."""
    if isinstance(expected, str | bool):
        return str(got) == str(expected)
    got, expected = float(got), float(expected)  # type: ignore[arg-type]
    if got == expected or (np.isnan(got) and np.isnan(expected)):
        return True
    if name.startswith(("fault", "param:", "seed")):
        return False
    if name.endswith(("_ms", "_count", "_ticks")):
        return (
            min(got, expected) >= 0
            and abs(got - expected) <= TICKS_OFF
            and (got > 0) == (expected > 0)
        )
    if name.startswith("peak_dac_") or name in (
        "check_overdrive_instant_margin",
        "check_overdrive_clip_margin",
    ):
        return abs(got - expected) <= DAC_OFF + RELATIVE * abs(expected)
    if name == "false_report_mm":
        return abs(got - expected) <= WHOLE_UM_OFF + RELATIVE * abs(expected)
    return abs(got - expected) <= ABSOLUTE + RELATIVE * abs(expected)


def main() -> None:
    """Replace the golden results."""
    found = compute()
    before = differences(found, read()) if RESULTS.is_file() else ["there were none"]
    found.to_csv(RESULTS, index=False, na_rep="nan", float_format="%.9g")
    print("\n".join(before) or "nothing changed beyond the tolerances")
    print(f"wrote {RESULTS}: {len(found)} runs")


if __name__ == "__main__":
    main()

"""Compares rules that stop a campaign: faults drawn until a rate is known, and how often they err.

    python analysis/stopping/stopping.py 0.05               # the tables of README.md

Each simulated campaign draws faults of which a known share does harm. It stops at the first look at
which the interval of the rate is +- half_width or narrower. A rule errs if an interval leaves out
the true rate: the interval at the stop, or that of any look, for somebody who does not stop.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import get_args

import numpy as np
from scipy.special import betaln, xlog1py, xlogy
from statsmodels.stats.proportion import proportion_confint

from ravenjax.campaign.file.sections import Stop
from ravenjax.stats.intervals import anytime_bounds, rate_bounds
from ravenjax.stats.sequential import Allocation, Sequential, Stratum

RATES = (0.005, 0.02, 0.1, 0.3, 0.5)
PLANNED = {0.05: 2048, 0.02: 16384, 0.01: 65536}
"""Draws that a user plans for each half-width."""
FIVE = (0.1, 0.2, 0.4, 0.7, 1.0)
TEN = (0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)
"""The looks of campaigns/evading_rates.toml."""
DEFAULT = Stop.model_fields["looks"].default
"""The looks of [stop], unless a campaign sets others."""
EACH_PERCENT = tuple(number / 100 for number in range(1, 101))
ALL = sorted({*FIVE, *TEN, *DEFAULT, *EACH_PERCENT})

Ends = tuple[np.ndarray, np.ndarray]
Bounds = Callable[[np.ndarray, np.ndarray], Ends]
"""Returns the interval of each rate k/n."""


def jeffreys(p: np.ndarray) -> Ends:
    """Return the prior Beta(a, b) that knows neither the rate nor the half-width."""
    return np.full(p.shape, 0.5), np.full(p.shape, 0.5)


def around(p: np.ndarray, half_width: float) -> Ends:
    """Return a prior around the rate that is tested, whatever the true one is. Its standard
    deviation is the half-width, because rates so far away have to be told apart.
    """
    size = np.maximum(p * (1 - p) / half_width**2, 1 / half_width)
    return size * p, size * (1 - p)


def mixture_bounds(
    k: np.ndarray, n: np.ndarray, alpha: float, prior: Callable[[np.ndarray], Ends]
) -> Ends:
    """Return the confidence sequence of a beta-binomial mixture (Howard, Ramdas, McAuliffe, Sekhon,
    Ann. Stat. 49, 2021)."""

    def excess(p: np.ndarray) -> np.ndarray:
        a, b = prior(p)
        likelihood = xlogy(k, p) + xlog1py(n - k, -p)
        return betaln(a + k, b + n - k) - betaln(a, b) - likelihood + math.log(alpha)

    ends = []
    for edge in (1e-9, 1 - 1e-9):
        outside, inside = np.full(k.shape, edge), np.clip(k / n, 1e-9, 1 - 1e-9)
        reached = excess(outside) <= 0
        for _ in range(50):
            middle = (outside + inside) / 2
            beyond = excess(middle) > 0
            outside, inside = np.where(beyond, middle, outside), np.where(beyond, inside, middle)
        ends.append(np.where(reached, round(edge), outside))
    return ends[0], ends[1]


def looks_at_counts(
    hits: np.ndarray, planned: int, looks: tuple[float, ...], bounds: Bounds
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield (draws, low, high) of each look. hits: [campaigns, looks of ALL]."""
    for share in looks:
        n = math.ceil(share * planned)
        few, back = np.unique(hits[:, ALL.index(share)], return_inverse=True)
        low, high = bounds(few, np.full(few.shape, n))
        yield n, low[back], high[back]


def looks_at_bets(
    bits: np.ndarray, p: float, half_width: float, alpha: float, plug_in: bool
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield the same of the hedged capital of bets on the draws `bits`, bool [campaigns, draws]
    (Waudby-Smith, Ramdas, J. R. Stat. Soc. B 86, 2024, theorem 3).

    The bets are the predictable plug-in of their equation 26, or half_width / variance. Rates
    within three half-widths of the true one are tested; an end beyond these is 0 or 1.
    """
    runs, planned = bits.shape
    near = p + half_width * np.linspace(-3, 3, 121)
    rates = np.concatenate([[1e-9], near[(near > 0) & (near < 1)], [1 - 1e-9]])
    up, down = np.zeros((runs, len(rates))), np.zeros((runs, len(rates)))
    total, squares, start, row = np.zeros(runs), np.zeros(runs), 0, np.arange(runs)
    for end in np.ceil(np.array(EACH_PERCENT) * planned).astype(int):
        while start < end:
            gain_up, gain_down = np.ones_like(up), np.ones_like(down)
            stretch = range(start, min(start + 32, end))
            for t in stretch:
                variance = (0.25 + squares) / (t + 1)
                bet = (
                    np.sqrt(2 * math.log(2 / alpha) / (variance * (t + 1) * math.log(t + 2)))
                    if plug_in
                    else half_width / variance
                )[:, None]
                far = bits[:, t, None] - rates
                gain_up *= 1 + np.minimum(bet, 0.5 / rates) * far
                gain_down *= 1 - np.minimum(bet, 0.5 / (1 - rates)) * far
                total += bits[:, t]
                squares += (bits[:, t] - (0.5 + total) / (t + 2)) ** 2
            up, down, start = up + np.log(gain_up), down + np.log(gain_down), stretch.stop
        excess = np.maximum(up, down) - math.log(2 / alpha)
        inside = excess <= 0
        ends = []
        for one, step in (
            (inside.argmax(1), -1),
            (inside.shape[1] - 1 - inside[:, ::-1].argmax(1), 1),
        ):
            next_out = np.clip(one + step, 0, len(rates) - 1)
            a, b = excess[row, one], excess[row, next_out]
            with np.errstate(all="ignore"):
                part = np.where(b > 0, a / (a - b), 0.0)
            ends.append(rates[one] + part * (rates[next_out] - rates[one]))
        yield int(end), np.where(ends[0] < 1e-8, 0.0, ends[0]), ends[1]


def course(
    looks: Iterator[tuple[int, np.ndarray, np.ndarray]], p: float, half_width: float, short: bool
) -> str:
    """Return a rule's mean draws and its errors in %, at the stop and at any look. short: no look
    comes after all campaigns have stopped, which saves time.
    """
    drawn = wrong = ever = np.zeros(1)
    going = np.ones(1, bool)
    for n, low, high in looks:
        missed, narrow = (p < low) | (p > high), (high - low) / 2 <= half_width
        drawn, wrong = np.where(going, n, drawn), np.where(going, missed, wrong)
        ever, going = (ever > 0) | missed, going & ~narrow
        if short and not going.any():
            break
    return f"{drawn.mean():.0f} ({wrong.mean():.1%}, {ever.mean():.1%})".replace("%", "")


def rules(half_width: float, alpha: float) -> dict[str, tuple[Bounds, tuple[float, ...]]]:
    """Return (bounds, looks) of each rule that needs only counts."""

    def exact(looks: tuple[float, ...]) -> tuple[Bounds, tuple[float, ...]]:
        # Clopper and Pearson's interval.
        return partial(proportion_confint, alpha=alpha / len(looks), method="beta"), looks

    ratio = partial(anytime_bounds, half_width=half_width, alpha=alpha)
    centred = partial(around, half_width=half_width)
    return {
        "planned, 5 looks": exact(FIVE),
        "planned, 10 looks": exact(TEN),
        "likelihood ratio, 5 looks": (ratio, FIVE),
        "likelihood ratio, default looks": (ratio, DEFAULT),
        "likelihood ratio, each percent": (ratio, EACH_PERCENT),
        "mixture around the tested rate": (
            partial(mixture_bounds, alpha=alpha, prior=centred),
            EACH_PERCENT,
        ),
        "mixture, prior of Jeffreys": (
            partial(mixture_bounds, alpha=alpha, prior=jeffreys),
            EACH_PERCENT,
        ),
        "null: Wilson, uncorrected": (partial(rate_bounds, alpha=alpha), EACH_PERCENT),
    }


def draw(p: float, planned: int, campaigns: int, grid: bool) -> np.ndarray:
    """Return whether each fault does harm, bool [campaigns, planned]. grid: of a table in which
    exactly the share p does harm, in random order.
    """
    random = np.random.default_rng([round(p * 1000), planned, grid])
    if not grid:
        return np.stack([random.random(planned, np.float32) < p for _ in range(campaigns)])
    table = np.arange(planned) < round(p * planned)
    return np.stack([random.permutation(table) for _ in range(campaigns)])


def compare(half_width: float, together: int, campaigns: int, grid: bool = False) -> None:
    """Print the table of one half-width. together: number of intervals that hold together."""
    planned, alpha = PLANNED[half_width], 0.05 / together
    table: dict[str, list[str]] = {}
    ends = np.ceil(np.array(ALL) * planned).astype(int)
    for p in RATES:
        bits = draw(p, planned, campaigns, grid)
        true = bits[0].mean() if grid else p
        hits = np.stack([np.cumsum(row, dtype=np.int64)[ends - 1] for row in bits])
        for name, (bounds, looks) in rules(half_width, alpha).items():
            found = looks_at_counts(hits, planned, looks, bounds)
            table.setdefault(name, []).append(course(found, true, half_width, False))
        for name, plug_in in (("bets, plug-in", True), ("bets of the half-width", False)):
            if not grid and half_width > 0.01:
                found = looks_at_bets(bits, p, half_width, alpha, plug_in)
                table.setdefault(name, []).append(course(found, p, half_width, True))
    kind = "the shuffled table" if grid else "draws"
    print(f"\n+-{half_width}, at most {planned} of {kind}, {together} intervals together\n")
    print("| rule |", " | ".join(f"{p:.1%}" for p in RATES), "|\n|---|" + "---|" * len(RATES))
    for name, cells in table.items():
        print(f"| {name} |", " | ".join(cells), "|", flush=True)


def whole_table(campaigns: int) -> None:
    """Print the same for the rate of a table of three groups, with the rule as it is used."""
    sizes, rates, half_width = (4000, 2000, 1000), np.array([0.02, 0.3, 0.08]), 0.02
    strata = tuple(Stratum(f"g{number}", size) for number, size in enumerate(sizes))
    true, random = rates @ sizes / sum(sizes), np.random.default_rng(0)
    print(f"\n+-{half_width}, the rate of a whole table of {sum(sizes)} draws in three groups\n")
    for allocation in get_args(Allocation):
        rule = Sequential(strata, ("rate",), half_width, DEFAULT, of="whole", allocation=allocation)
        drawn, missed = [], np.zeros((campaigns, 2), bool)
        for campaign in range(campaigns):
            counts = [
                np.cumsum(random.random(size) < p) for size, p in zip(sizes, rates, strict=True)
            ]
            taken, number, stop = rule.sizes()[0], 0, False
            while not stop:
                k = np.array([[of[n - 1] for of, n in zip(counts, taken, strict=True)]])
                look = rule.decide(number := number + 1, taken, k, taken)
                (one,), stop = look.intervals, look.stop
                wrong = not one.low <= true <= one.high
                missed[campaign] = wrong, missed[campaign, 1] or wrong
                if not stop:
                    taken = rule.next_sizes(look, k, taken)
            drawn.append(taken.sum())
        at_stop, at_any = missed.mean(axis=0) * 100
        print(f"{allocation}: {np.mean(drawn):.0f} ({at_stop:.1f}, {at_any:.1f})")


if __name__ == "__main__":
    options = argparse.ArgumentParser()
    options.add_argument("half_width", type=float, nargs="*", default=list(PLANNED))
    options.add_argument("--campaigns", type=int, default=2000)
    chosen = options.parse_args()
    for half_width in chosen.half_width:
        for together in (1, 8):
            compare(half_width, together, chosen.campaigns)
        compare(half_width, 1, chosen.campaigns, grid=True)
    whole_table(chosen.campaigns)

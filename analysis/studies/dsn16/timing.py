"""How packets come in the studies of the targeted attacks: as a recorded robot had them, and what
else is possible.

The publication's generator waits a millisecond, then packs and prints: one or two control cycles by
its code, how many is not told. In a log of a real arm that came with it
(`ravenjax.vocabulary.packets`) 93 of 100 packets last two. It is not known whether the generator's
did, so other lengths stand beside it. The hand keeps its speed: a packet carries its place at that
moment, so that steps from packet to packet add up to the motion. A generator that sends the next
row of a log, however long a packet lasts, replays it slower: a variant.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from studies.dsn16.runs import VariantRuns
from studies.framework.study import Variant

DECLARED = "as_declared"
"""The variant that has the baseline which was declared before packets were measured."""

EVERY_CYCLE = ("campaign.packets=every_cycle", "campaign.duration_s=3")
SLOW_REPLAY = ("campaign.packets=every_cycle", "parameters.network.cycles_per_packet=2")

LENGTHS = {
    "every_cycle": (EVERY_CYCLE, "a packet each control cycle"),
    "one_or_two": (
        ("campaign.packets=[0.5,0.5]", "campaign.duration_s=4"),
        "half of the packets last one cycle, half two (assumed)",
    ),
    "bursts": (
        ("campaign.packets=bursts", "campaign.duration_s=7.5"),
        "packets in bursts, as a recorded console sends",
    ),
    "slow_replay": (
        SLOW_REPLAY,
        "each packet lasts two cycles and is the motion's next row: half the speed",
    ),
}
"""Other lengths of packets, by name: overrides and question. Runs are long enough for the last
fault and 0.8 s more.
"""

DRAWS = {f"draws_{k}": (f"campaign.seed={2015 + k}",) for k in (2, 3)}
"""The same distribution, drawn again."""


def variants(campaign: str, *more: str) -> tuple[Variant, ...]:
    """Of a campaign whose own packets last as measured; more: overrides of all."""
    lengths = (
        Variant(name, campaign, (*over, *more), question)
        for name, (over, question) in LENGTHS.items()
    )
    draws = (
        Variant(n, campaign, (*over, *more), "other draws of packet lengths")
        for n, over in DRAWS.items()
    )
    return (*lengths, *draws)


def spread(runs: Iterable[VariantRuns], hit: str) -> np.ndarray | None:
    """Lowest and highest percent by duration over other lengths of packets, [2, durations]; None
    without any.
    """
    percent = [one.percent(hit) for one in runs if one.name in LENGTHS]
    return np.stack([np.min(percent, axis=0), np.max(percent, axis=0)]) if percent else None


def lengths_note(base: VariantRuns, runs: Iterable[VariantRuns]) -> str:
    """How far the length of packets moves the jumps, in words."""
    shares = {
        one.name: float(one.percent("jump").mean())
        for one in (base, *runs)
        if one.name in (base.name, *LENGTHS)
    }
    listed = ", ".join(f"{name} {share:.1f} %" for name, share in shares.items())
    if len(shares) < 2:
        return ""
    return (
        f"Runs that jump, by how long packets last: {listed}. The publication does not tell it, so"
        f" this prediction is no narrower than {min(shares.values()):.1f} to"
        f" {max(shares.values()):.1f} %."
    )


def draws_note(base: VariantRuns, runs: Iterable[VariantRuns]) -> str:
    """How far the draws of packet lengths move the jumps, in words; empty without other draws."""
    others = [float(one.percent("jump").mean()) for one in runs if one.name in DRAWS]
    if not others:
        return ""
    own = float(base.percent("jump").mean())
    return (
        f" How long each packet lasts is drawn anew in each run: {own:.1f} % of all runs jump, "
        f"{' and '.join(f'{x:.1f} %' for x in others)} with other draws."
    )

"""Before any data are taken: how small a p a study of so many people can reach, and how many it
needs.

`comparison` exchanges conditions within or between participants. So few people can be exchanged in
so few ways that even the largest effect has no small p: the smallest is two of all ways, since both
directions count. Holm's adjustment multiplies the smallest p of a family by the number of its
comparisons. Where that stays above 1 - confidence, no result can be clear, and the study should not
be begun.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from typing import NamedTuple

from ravenjax.errors import UserError
from ravenjax.stats.comparison.clustered import DRAWS
from ravenjax.stats.intervals import alpha_of
from ravenjax.train.study.comparison import OUTCOMES

MOST = 10_000
"""Participants; who needs more is told so."""


class StudyPlan(NamedTuple):
    """What a study of this size can show."""

    participants: int  # all together
    paired: bool  # each does both conditions
    comparisons: int  # in Holm's family
    smallest_p: float
    adjusted: float  # by Holm, the smallest
    possible: bool  # whether any comparison can be clear
    needed: int  # participants all together, for that
    for_effect: int | None  # for the effect that was asked for, with its power; None: none was


def plan(
    participants: int,
    *,
    paired: bool = True,
    groups: int = 2,
    outcomes: int = len(OUTCOMES),
    effect: float | None = None,
    power: float = 0.8,
    confidence: float = 0.95,
) -> StudyPlan:
    """What `participants` can show where every group is compared with the first on every outcome
    that varies.

    paired: each does all conditions. effect: standardised difference (Cohen's d; of differences
    where paired) that is to be found with this power. UserError where a number makes no sense.
    """
    for name, value, least in (
        ("participants", participants, 1),
        ("groups", groups, 2),
        ("outcomes", outcomes, 1),
    ):
        if value < least:
            raise UserError(f"{name} is {value}, expected at least {least}")
    if not 0.0 < power < 1.0:
        raise UserError(f"power is {power:g}, expected a number between 0 and 1, such as 0.8")
    if effect is not None and not 0.0 < effect < math.inf:
        raise UserError(f"effect is {effect:g}, expected a number above 0, such as 0.5")
    comparisons, alpha = (groups - 1) * outcomes, alpha_of(confidence)
    smallest = smallest_p(participants, paired, groups)
    needed = _least(lambda n: comparisons * smallest_p(n, paired, groups) <= alpha)
    for_effect = None
    if effect is not None:
        for_effect = max(needed, _for_effect(effect, power, alpha / comparisons, paired, groups))
    adjusted = min(1.0, comparisons * smallest)
    return StudyPlan(
        participants, paired, comparisons, smallest, adjusted, adjusted <= alpha, needed, for_effect
    )


def smallest_p(participants: int, paired: bool = True, groups: int = 2) -> float:
    """The least two-sided p of an exchange test of two groups, people spread evenly over
    `groups`; 1 below two.
    """
    if paired:
        ways = 2**participants if participants > 1 else 1
    else:
        each = participants // groups
        larger = each + (participants % groups > 0)
        ways = math.comb(each + larger, each) if each > 1 else 1
    return min(1.0, 2.0 / min(ways, DRAWS + 1))


def sentences(plan: StudyPlan) -> str:
    """The plan in words."""
    design = "who do both conditions" if plan.paired else "each in one group"
    family = f"{plan.comparisons} comparisons" if plan.comparisons > 1 else "one comparison"
    verdict = "no result can be clear, however large the effect"
    if plan.possible:
        verdict = "a clear result is possible"
    why = f", as {DRAWS:,} exchanges are drawn" if plan.smallest_p <= 2.0 / (DRAWS + 1) else ""
    lines = [
        f"{plan.participants} participants, {design}: the smallest p is {plan.smallest_p:.3g}{why};"
        f" after Holm over {family} {plan.adjusted:.3g}: {verdict}.",
        f"The least for a clear result: {plan.needed} participants.",
    ]
    if plan.for_effect is not None:
        lines.append(f"For the effect that is to be found: {plan.for_effect} participants.")
    lines.append(
        "An outcome that does not vary is not compared, which makes the family smaller; who drops"
        " out makes it harder."
    )
    return "\n".join(lines)


def _for_effect(effect: float, power: float, alpha: float, paired: bool, groups: int) -> int:
    """Participants, by Student's t-test at Holm's first level: somewhat fewer than an exchange
    test of few needs.
    """
    # slow to import
    from statsmodels.stats.power import TTestIndPower, TTestPower

    test = TTestPower() if paired else TTestIndPower()
    each = _least(lambda n: n > 1 and float(test.power(effect, n, alpha)) >= power)
    return each if paired else groups * each


def _least(enough: Callable[[int], bool]) -> int:
    """The least number for which it is enough; for larger ones it is, too."""
    low, high = 0, 1
    while not enough(high):
        low, high = high, 2 * high
        if low > MOST:
            raise UserError(
                f"more than {MOST} participants are needed: ask for a larger effect or fewer"
                " comparisons"
            )
    return bisect.bisect_left(range(high), True, lo=low + 1, key=enough)

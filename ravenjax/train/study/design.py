"""Plans a study: assigns participants to groups, and computes the smallest p that a number of
participants can reach and how many are needed.

`comparison` exchanges conditions within or between participants. So few people can be exchanged in
so few ways that even the largest effect has no small p: the smallest is two of all ways, since both
directions count. Holm's adjustment multiplies the smallest p of a family by the number of its
comparisons. Where that stays above 1 - confidence, no result can be clear, and the study should not
be begun.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError, shown
from ravenjax.stats.comparison.clustered import DRAWS
from ravenjax.stats.intervals import alpha_of

MOST = 10_000
"""The largest number of participants that a plan looks for."""


class Assignment(NamedTuple):
    """One participant's condition; `block` counts from 0."""

    participant: str
    group: str
    block: int


def assign(
    participants: Sequence[str], groups: Sequence[str], seed: int, block: int | None = None
) -> list[Assignment]:
    """Permuted blocks: in each run of `block` participants every group comes equally often, in
    random order.

    The same arguments give the same list, and participants may be appended later without changing
    those before. block: a multiple of the number of groups, twice that if left out; a longer one is
    harder to guess, a shorter one keeps the groups closer to balance when a study ends early.
    Raises UserError where names repeat or the block does not fit.
    """
    for what, names in (("participants", participants), ("groups", groups)):
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise UserError(
                f"{what}: {', '.join(repeated)} given more than once; expected each name once"
            )
    if seed < 0:
        raise UserError(f"seed is {seed}, expected 0 or more")
    if len(groups) < 2:
        raise UserError(f"groups: got {shown(groups)}, expected at least two to compare")
    size = 2 * len(groups) if block is None else block
    if size < 1 or size % len(groups):
        raise UserError(
            f"block {size}: expected a multiple of the {len(groups)} groups, such as"
            f" {2 * len(groups)}, so that each comes equally often"
        )
    assignments = []
    for number, first in enumerate(range(0, len(participants), size)):
        order = np.random.default_rng([seed, number]).permutation(
            list(groups) * (size // len(groups))
        )
        people = participants[first : first + size]
        assignments += [
            Assignment(person, str(group), number)
            for person, group in zip(people, order, strict=False)
        ]
    return assignments


class StudyPlan(NamedTuple):
    """What a study of this size can show."""

    # All together.
    participants: int
    # Each does both conditions.
    paired: bool
    # In Holm's family.
    comparisons: int
    smallest_p: float
    # By Holm, the smallest.
    adjusted: float
    # Whether any comparison can be clear.
    possible: bool
    # Participants all together, for that.
    needed: int
    # For the effect that was asked for, with its power; None: none was.
    for_effect: int | None


def plan(
    participants: int,
    *,
    paired: bool = True,
    groups: int = 2,
    outcomes: int = 4,
    effect: float | None = None,
    power: float = 0.8,
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
    comparisons, alpha = (groups - 1) * outcomes, alpha_of(0.95)
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


def describe_plan(plan: StudyPlan) -> str:
    """The plan in words."""
    design = "who do both conditions" if plan.paired else "each in one group"
    verdict = "no result can be clear, however large the effect"
    if plan.possible:
        verdict = "a clear result is possible"
    lines = [
        f"{plan.participants} participants, {design}: the smallest p is {plan.smallest_p:.3g};"
        f" after Holm over {plan.comparisons} comparisons {plan.adjusted:.3g}: {verdict}.",
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
    # The import is slow.
    from statsmodels.stats.power import TTestIndPower, TTestPower

    test = TTestPower() if paired else TTestIndPower()
    each = _least(lambda n: n > 1 and float(test.power(effect, n, alpha)) >= power)
    return each if paired else groups * each


def _least(enough: Callable[[int], bool]) -> int:
    least = next((number for number in range(1, MOST + 1) if enough(number)), None)
    if least is None:
        raise UserError(
            f"more than {MOST} participants are needed: ask for a larger effect or fewer"
            " comparisons"
        )
    return least

"""Plans a study: assigns participants to groups, and computes how many participants it needs.

`comparison` permutes conditions within or between participants. A small number of people has few
permutations, so even the largest effect has no small p. The smallest p is two over the number of
permutations, since both directions count. Holm's adjustment multiplies the smallest p of a family
by the number of its comparisons. If the result stays above 1 - confidence, no result can be clear,
and the study should not begin.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError, format_value
from ravenjax.stats.comparison.clustered import DRAWS
from ravenjax.stats.intervals import alpha_of

MOST = 10_000
"""The largest number of participants that a plan considers."""


class Assignment(NamedTuple):
    """One participant's condition; `block` counts from 0."""

    participant: str
    group: str
    block: int


def assign_groups(
    participants: Sequence[str], groups: Sequence[str], seed: int, block: int | None = None
) -> list[Assignment]:
    """Assign participants to groups in permuted blocks.

    In each run of `block` participants every group comes equally often, in random order. The same
    arguments give the same list, to which participants may be appended. block: a multiple of the
    number of groups, by default twice that number. Raises UserError if names repeat or the block
    does not fit.
    """
    for what, names in (("participants", participants), ("groups", groups)):
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise UserError(
                f"{what}: {', '.join(repeated)} given more than once; expected each name once"
            )
    if seed < 0:
        raise UserError(f"seed is {seed}, expected 0 or more")
    if len(groups) < 2:
        raise UserError(f"groups: got {format_value(groups)}, expected at least two to compare")
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
    """The results that a study of this size can reach."""

    # In all groups together.
    participants: int
    # Whether each participant does both conditions.
    paired: bool
    # Size of Holm's family.
    comparisons: int
    smallest_p: float
    # The smallest p after Holm's adjustment.
    adjusted: float
    # Whether any comparison can be clear.
    possible: bool
    # Participants needed for that, in all groups together.
    needed: int
    # Participants needed for the requested effect with its power; None: no effect was requested.
    for_effect: int | None


def plan_study(
    participants: int,
    *,
    paired: bool = True,
    groups: int = 2,
    outcomes: int = 4,
    effect: float | None = None,
    power: float = 0.8,
) -> StudyPlan:
    """Compute what `participants` can show if every group is compared with the first.

    The comparison includes every outcome that varies. paired: whether each does all conditions.
    effect: standardised difference (Cohen's d; of differences if paired) to be found with this
    power. Raises UserError if a number makes no sense.
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
        # The import is slow.
        from statsmodels.stats.power import TTestIndPower, TTestPower

        test, each = (TTestPower(), 1) if paired else (TTestIndPower(), groups)
        # Student's t-test at Holm's first level.
        first = alpha / comparisons
        least = _least(lambda n: n > 1 and float(test.power(effect, n, first)) >= power)
        for_effect = max(needed, each * least)
    adjusted = min(1.0, comparisons * smallest)
    return StudyPlan(
        participants, paired, comparisons, smallest, adjusted, adjusted <= alpha, needed, for_effect
    )


def smallest_p(participants: int, paired: bool = True, groups: int = 2) -> float:
    """Return the least two-sided p of a permutation test of two groups; 1 below two people."""
    if paired:
        ways = 2**participants if participants > 1 else 1
    else:
        each = participants // groups
        larger = each + (participants % groups > 0)
        ways = math.comb(each + larger, each) if each > 1 else 1
    return min(1.0, 2.0 / min(ways, DRAWS + 1))


def describe_plan(plan: StudyPlan) -> str:
    """Return the plan in words."""
    design = "who do both conditions" if plan.paired else "each in one group"
    verdict = "a clear result is possible" if plan.possible else "no result can be clear"
    lines = [
        f"{plan.participants} participants, {design}: the smallest p is {plan.smallest_p:.3g};"
        f" after Holm over {plan.comparisons} comparisons {plan.adjusted:.3g}: {verdict}.",
        f"A clear result needs at least {plan.needed} participants.",
    ]
    if plan.for_effect is not None:
        lines.append(f"For the given effect and power: {plan.for_effect} participants.")
    lines.append(
        "An outcome that does not vary is not compared, which helps; participants who drop out"
        " make a clear result harder."
    )
    return "\n".join(lines)


def _least(enough: Callable[[int], bool]) -> int:
    least = next((number for number in range(1, MOST + 1) if enough(number)), None)
    if least is None:
        raise UserError(
            f"more than {MOST} participants are needed: choose a larger effect or fewer comparisons"
        )
    return least

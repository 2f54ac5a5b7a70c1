"""Who gets which condition: randomised by seed, balanced in blocks."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError, shown


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
    people, names = [str(one) for one in participants], [str(one) for one in groups]
    for what, entries in (("participants", people), ("groups", names)):
        repeated = sorted({one for one in entries if entries.count(one) > 1})
        if repeated:
            raise UserError(
                f"{what}: {', '.join(repeated)} given more than once; expected each name once"
            )
    if seed < 0:
        raise UserError(f"seed is {seed}, expected 0 or more")
    if len(names) < 2:
        raise UserError(f"groups: got {shown(names)}, expected at least two to compare")
    size = 2 * len(names) if block is None else block
    if size < 1 or size % len(names):
        raise UserError(
            f"block {size}: expected a multiple of the {len(names)} groups, such as"
            f" {2 * len(names)}, so that each comes equally often"
        )
    out = []
    for first in range(0, len(people), size):
        number = first // size
        order = np.random.default_rng([seed, number]).permutation(names * (size // len(names)))
        out += [
            Assignment(one, str(name), number)
            for one, name in zip(people[first : first + size], order, strict=False)
        ]
    return out


def as_csv(assignments: Sequence[Assignment]) -> str:
    """The list as CSV with a header."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(Assignment._fields)
    writer.writerows(assignments)
    return out.getvalue()

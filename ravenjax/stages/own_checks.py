"""Checks of one's own: files that look at a seam of the tick and act in the same millisecond.

As detectors they give a score in each millisecond of each arm (`ravenjax.parts`), and trip where it
is above their threshold in `consecutive` milliseconds in a row. They differ in where they stand:
between two stages, as the built-in checks do, so that what they do is done before the next stage
reads. What they may do is what the robot's own checks do:

- `watch`: nothing; they leave their columns, and count as no response;
- `flag`: tell a person. The robot goes on; a run in which one trips counts as flagged;
- `limit`: on an arm where they trip, something else goes on in this millisecond: what `step` gives
  as a third thing;
- `stop`: raise the robot's E-stop as its own checks raise it; how, the robot says where it asks
  them.

They look in every millisecond, at every run level: what is none of their business they leave alone
by themselves, by what is in their view. What they leave is as of the built-in checks: first trip,
milliseconds tripped, and the margin, which is the threshold less the score, of the arm and
millisecond where it was smallest.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.setup import Setup, per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.parts import parameters, part
from ravenjax.vocabulary.checks import CheckUse
from ravenjax.vocabulary.parts import OwnSource

THRESHOLD = Quantity("of the score", 0, 1e6, "score above which the check trips")
"""What a threshold may be."""


@record
class OwnCheckParams:
    """What a campaign may vary, each by its check's name."""

    own: tuple[Any, ...]  # its own record, or None
    threshold: tuple[Scalar, ...]  # in the unit of its score


@record
class OwnCheckArmState:
    own: Any  # what its `init` gave
    recent: Vec  # scores of the last ticks, latest first, one less than `consecutive`


class OwnCheckTrip(NamedTuple):
    """What a check says in this millisecond. Tuples have one entry an arm."""

    arms: tuple[OwnCheckArmState, ...]  # what it remembers from now on
    trips: tuple[Scalar, ...]  # bool
    margin: Scalar  # threshold less score, of the worse arm
    values: tuple[Vec, ...]  # what goes on where it limits; else what came


def sources(setup: Setup) -> tuple[OwnSource, ...]:
    """Files of the checks, in order."""
    return tuple(use.part for use in setup.checks)


def params(setup: Setup, thresholds: Sequence[float]) -> OwnCheckParams:
    """What the files say, and these thresholds, in the order of the checks."""
    names = tuple(use.name for use in setup.checks)
    return OwnCheckParams(parameters.of(sources(setup)), parameters.named(names, thresholds))


def init(setup: Setup, params: OwnCheckParams) -> tuple[tuple[OwnCheckArmState, ...], ...]:
    """Nothing seen; one entry a check, in it one an arm."""

    def of_check(use: CheckUse, values: Any) -> tuple[OwnCheckArmState, ...]:
        own = part.init(part.loaded(use.part), values, setup.precision.real)
        arm = OwnCheckArmState(own, Vec.full(use.consecutive - 1, real(setup, 0.0)))
        return (arm,) * len(setup.arms)

    return tuple(
        of_check(use, values) for use, values in zip(setup.checks, params.own, strict=True)
    )


def look(
    setup: Setup,
    params: OwnCheckParams,
    before: tuple[OwnCheckArmState, ...],
    place: int,
    views: Sequence[Any],
    crossing: Sequence[Vec],
) -> OwnCheckTrip:
    """The check at `place` in this millisecond. views: what it sees, one an arm. crossing: what
    crosses its seam.
    """
    use, code = setup.checks[place], part.loaded(setup.checks[place].part)
    own, threshold, width = params.own[place], params.threshold[place], setup.precision.real

    def of_arm(i: int, _: Any) -> tuple[OwnCheckArmState, Scalar, Scalar, Vec]:
        arm, values = before[i], crossing[i]
        if use.acts == "limit" and values:
            after, score, values = part.limiting_step(code, own, arm.own, views[i], width, values)
        else:
            after, score = part.step(code, own, arm.own, views[i], width)
        score = jnp.where(score == score, score, 0.0)  # what is no number is above no threshold
        lowest = reduce(jnp.minimum, [score, *arm.recent])
        recent = Vec((score, *arm.recent)[: len(arm.recent)])
        return OwnCheckArmState(after, recent), lowest > threshold, threshold - lowest, values

    arms, trips, margins, values = zip(*per_arm(setup, of_arm), strict=True)
    return OwnCheckTrip(arms, trips, reduce(jnp.minimum, margins), values)

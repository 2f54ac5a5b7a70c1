"""Scores as a part of one's own: the text of a Python file that a campaign takes as a detector.

The largest of the scores is the part's. Scales are its parameters, a Vec a score, so a campaign may
vary them. Values are taken as floats before anything else is done with them, in the order `abs(x -
y) / scale`.
"""

from __future__ import annotations

from collections.abc import Sequence

from ravenjax.analyses.monitors.scores import Score
from ravenjax.errors import UserError

RANGE = "1e-12, 1e12"
"""Of a scale, in its unit."""
_HEAD = "from ravenjax.parts import Annotated, Quantity, Scalar, Vec, jnp, record"


def text(scores: Sequence[Score], title: str = "") -> str:
    """The file's text, formatted as Python is. UserError for no scores, and for two of one name."""
    names = [score.name for score in scores]
    if not names or len(set(names)) < len(names):
        raise UserError(
            "a part file needs one score or more of different names, got"
            f" {', '.join(names) or 'none'}"
        )
    remembers = [score for score in scores if score.kind == "rate"]
    lines = [
        f'"""{title or "Largest of: " + "; ".join(score.words for score in scores)}."""',
        "",
        _HEAD,
        "",
        "",
    ]
    lines += ["@record", "class Scales:"]
    for score in scores:
        lines += _scale(score)
    lines += ["", ""]
    if remembers:
        lines += ["@record", "class Before:", "    begun: Scalar  # bool"]
        lines += [
            f"    {score.name}: Vec  # {score.signal} a millisecond ago, as floats"
            for score in remembers
        ]
        lines += ["", ""]
    lines += ["def params():", "    return Scales("]
    lines += [
        f"        {score.name}=Vec([{', '.join(map(repr, score.scales))}])," for score in scores
    ]
    lines += ["    )", "", ""]
    if remembers:
        zeros = "".join(f", {score.name}=Vec.full({len(score.scales)}, 0.0)" for score in remembers)
        lines += ["def init(params):", f"    return Before(begun=False{zeros})", "", ""]
    lines += ["def step(params, state, view):", "    score = 0.0"]
    for score in scores:
        lines += _term(score)
    after = "".join(f", {score.name}={score.name}" for score in remembers)
    lines += [f"    return {f'Before(begun=True{after})' if remembers else 'state'}, score"]
    return "\n".join(lines) + "\n"


def _scale(score: Score) -> list[str]:
    several = sorted(set(score.units), key=score.units.index)
    unit = (
        several[0]
        if len(several) == 1
        else "; ".join(map(":".join, zip(score.labels, score.units, strict=True)))
    )
    return [
        f"    {score.name}: Annotated[",
        "        Vec,",
        f'        Quantity("{unit}", {RANGE}, "{score.words}, at which the score is 1"),',
        "    ]",
    ]


def _term(score: Score) -> list[str]:
    """Lines that raise `score` to this one's where it is larger; what is no number is not."""
    own, other = _values(score.signal, score.channels), _values(score.against, score.channels)
    lines = [f"    {score.name} = {own}"]
    if score.kind == "bound":
        lines += [
            f"    for now, scale in zip({score.name}, params.{score.name}):",
            "        one = jnp.abs(now) / scale",
        ]
    elif score.kind == "residual":
        lines += [
            f"    for now, other, scale in zip({score.name}, {other}, params.{score.name}):",
            "        one = jnp.abs(now - other) / scale",
        ]
    else:
        lines += [
            (
                f"    for now, before, scale in zip({score.name}, state.{score.name},"
                f" params.{score.name}):"
            ),
            "        one = jnp.where(state.begun, jnp.abs(now - before) / scale, 0.0)",
        ]
    return [*lines, "        score = jnp.where(one > score, one, score)"]


def _values(field: str, channels: Sequence[int]) -> str:
    if not channels:
        return f"Vec([1.0 * view.{field}])"
    return f"Vec(1.0 * view.{field}[i] for i in {list(channels)})"

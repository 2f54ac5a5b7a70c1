"""A monitor as a part of one's own: the text of a Python file that a campaign takes as a detector.

Every number is read as a float, and one that is no number as 0, which also keeps an engine from
joining the read with the subtraction that follows: what a robot's own code computes from the same
numbers then has the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence

from ravenjax.analyses.monitors.monitor import Monitor, Segments, read_of, reads
from ravenjax.analyses.monitors.scores import Score

_HEAD = "from ravenjax.parts import Scalar, jnp, record"


def text(monitor: Monitor, title: str = "", records: bool = False) -> str:
    """The file's text. records: it also remembers what it reads, as `read_NAME`, and its
    `score`.
    """
    return _text(monitor.terms, monitor.segments, monitor.scales, title, None, records)


def measuring(term: Score, segments: Segments, segment: int) -> str:
    """The text of a part whose score is a term's size while an operation is in a segment, else
    0.
    """
    scales = ((1.0,) * segments.count,)
    return _text((term,), segments, scales, f"{term.words}, segment {segment}", segment, False)


def _text(
    terms: Sequence[Score],
    segments: Segments,
    scales: Sequence[Sequence[float]],
    title: str,
    only: int | None,
    records: bool,
) -> str:
    before = [term for term in terms if term.kind == "rate"]
    numbers = reads(tuple(terms), segments)
    lines = [
        f'"""{title or "Largest of: " + "; ".join(term.words for term in terms)}."""',
        "",
        _HEAD,
        "",
        "",
    ]
    fields = [
        "begun: Scalar  # bool",
        *(f"before_{read_of(term, term.signal)}: Scalar" for term in before),
    ]
    stored = [f"read_{name}: Scalar" for name in numbers] + ["score: Scalar"] if records else []
    remembers = bool(before) or records
    if remembers:
        lines += ["@record", "class Before:", *(f"    {one}" for one in fields + stored), "", ""]
        zeros = ", ".join(["False", *["0.0"] * (len(fields) - 1 + len(stored))])
        lines += ["def init(params):", f"    return Before({zeros})", "", ""]
    lines += ["def number(x):", "    x = 1.0 * x", "    return jnp.where(x == x, x, 0.0)", "", ""]
    lines += ["def step(params, state, view):"]
    lines += [f"    {name} = number({place})" for name, place in numbers.items()]
    lines += [
        f"    past{k} = {segments.field} >= {edge!r}" for k, edge in enumerate(segments.edges)
    ]
    lines += ["    score = 0.0"]
    for term, own in zip(terms, scales, strict=True):
        lines += _term(term, own)
    if only is not None and segments.count > 1:
        lines += [f"    score = jnp.where({_inside(only, segments)}, score, 0.0)"]
    after = [
        "True",
        *(read_of(term, term.signal) for term in before),
        *(numbers if records else ()),
    ]
    after += ["score"] if records else []
    state = f"Before({', '.join(after)})" if remembers else "state"
    lines += [f"    return {state}, score"]
    return "\n".join(lines) + "\n"


def _term(term: Score, scales: Sequence[float]) -> list[str]:
    own = read_of(term, term.signal)
    size = {
        "bound": f"jnp.abs({own})",
        "residual": f"jnp.abs({own} - {read_of(term, term.against)})",
        "rate": f"jnp.where(state.begun, jnp.abs({own} - state.before_{own}), 0.0)",
    }[term.kind]
    scale = repr(float(scales[0]))
    for k, later in enumerate(scales[1:]):
        scale = f"jnp.where(past{k}, {float(later)!r}, {scale})"
    return [f"    one = {size} / {scale}", "    score = jnp.where(one > score, one, score)"]


def _inside(segment: int, segments: Segments) -> str:
    ends = [f"past{segment - 1}"] if segment else []
    ends += [f"~past{segment}"] if segment < len(segments.edges) else []
    return " & ".join(ends)

"""Defines harms as expressions of signal temporal logic, such as those in a campaign file.

    depth > 2 and once[0:100](speed > 50)

An expression is true if its *robustness* is positive (Donze and Maler 2010). The robustness of a
comparison is the distance of its signal from the limit, in the unit of the signal. `and` takes the
smallest robustness of its operands, `or` the largest, and `not` changes the sign.

A window `[a:b]` is in ms. `once` takes the largest robustness in a window of the past, and
`historically` the smallest; without a window they take the whole past. `eventually` and `always` do
the same for a window in the future. Such an expression is evaluated when all of its windows are
over. No window reaches beyond the beginning of the run.
"""

import ast
import dataclasses
import functools
import itertools
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax.bundled import resources
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import Setup, cast_to_real, for_each_arm
from ravenjax.numbers.vec import Scalar, Vec, earliest_tick, first_tick, largest, record

SIGNALS: dict[str, str] = resources.read_tables(__file__, "harm.toml")
"""What an expression reads, for each arm. All tips are the true ones."""
MOST_MS = 500
"""Longest memory of an expression. Each millisecond costs every run some time."""
_WINDOWS = {"once": True, "eventually": True, "historically": False, "always": False}
"""Whether the operator takes the largest, rather than the least, of its window."""
_AHEAD = ("eventually", "always")
_ARITHMETIC = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul}


class HarmUse(NamedTuple):
    """One harm of a campaign; static."""

    name: str
    when: str  # expression
    counts: str  # joins, replaces or watch: what becomes of the limit of unintended motion


@record
class HarmState:
    """What one harm has done so far."""

    memory: tuple[tuple[Vec, ...], ...]  # of each arm: values of the last milliseconds
    peak: Scalar  # largest robustness
    first: Scalar  # int32, tick in which it was first positive; -1: never


@dataclasses.dataclass(eq=False)
class Moment:
    """The signals of one arm in this tick, and what its expression remembers."""

    signals: Mapping[str, Scalar]
    tick: Scalar
    before: Iterator[Vec] | None = None  # None: before the first tick
    after: list[Vec] = dataclasses.field(default_factory=list)

    def remember(self, ticks: int, empty: Scalar, new: Callable[[Vec], Vec]) -> Vec:
        """Return the values of the last ticks, latest first, and remember `new` of them."""
        first = self.before is None
        before = Vec.full(ticks, empty) if self.before is None else next(self.before)
        self.after.append(before if first else new(before))
        return before

    def delay(self, value: Scalar, ticks: int, empty: Scalar) -> Scalar:
        """Return the value of `ticks` ticks ago."""
        if not ticks:
            return value
        return self.remember(ticks, empty, lambda before: Vec((value, *before[:-1])))[-1]

    def since(self, ticks: int, value: Scalar, empty: Scalar) -> Scalar:
        """Return a value of `ticks` ticks ago, or `empty` if the run began later."""
        return jnp.where(self.tick >= ticks, value, empty) if ticks else value


class Formula(NamedTuple):
    """A part of an expression. value: returns its robustness a given number of ms ago."""

    ahead: int  # ms that it looks ahead
    value: Callable[[Moment, int], Scalar]


@functools.cache
def parse_harm(text: str) -> Formula:
    """Return the expression of a harm. Raises ValueError for one that is not understood."""
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError) as error:
        raise ValueError(f"got {text!r}, expected an expression such as depth > 2") from error
    formula = _truth(tree)
    moment = Moment(dict.fromkeys(SIGNALS, 0.0), 0)
    formula.value(moment, formula.ahead)
    if (needed := sum(map(len, moment.after))) > MOST_MS:
        raise ValueError(
            f"its windows and delays take a memory of {needed} ms, expected at most {MOST_MS}:"
            " shorten them, or write once(..) or historically(..) of the whole past"
        )
    return formula


def _error(node: ast.AST, expected: str) -> ValueError:
    return ValueError(f"got {ast.unparse(node)!r}, expected {expected}")


def _number(node: ast.AST) -> Callable[[Moment], Scalar]:
    match node:
        case ast.Name(name) if name in SIGNALS:
            return lambda moment: moment.signals[name]
        case ast.Name(name):
            raise _error(node, f"one of {', '.join(SIGNALS)}")
        case ast.Constant(int() | float() as number) if type(number) is not bool:
            return lambda moment: float(number)
        case ast.UnaryOp(ast.USub(), inner):
            value = _number(inner)
            return lambda moment: -value(moment)
        case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC:
            a, b, combine = _number(left), _number(right), _ARITHMETIC[type(op)]
            return lambda moment: combine(a(moment), b(moment))
        case ast.Call(ast.Name("abs"), [inner], []):
            value = _number(inner)
            return lambda moment: jnp.abs(value(moment))
    raise _error(node, "a signal, a number, or a sum, difference, product or abs(..) of them")


def _truth(node: ast.AST) -> Formula:
    match node:
        case ast.Compare(left, ops, rights) if all(type(op) in (ast.Gt, ast.Lt) for op in ops):
            terms = [_number(term) for term in (left, *rights)]

            def distance(moment: Moment, delay: int) -> Scalar:
                pairs = itertools.pairwise(term(moment) for term in terms)
                least = functools.reduce(
                    jnp.minimum,
                    (
                        a - b if type(op) is ast.Gt else b - a
                        for (a, b), op in zip(pairs, ops, strict=True)
                    ),
                )
                return moment.delay(least, delay, 0.0)

            return Formula(0, distance)
        case ast.Compare():
            raise _error(node, "comparisons by > and <: for a whole number write > 2.5")
        case ast.BoolOp(op, values):
            most = jnp.minimum if isinstance(op, ast.And) else jnp.maximum
            return _combine(most, [_truth(value) for value in values])
        case ast.UnaryOp(ast.Not(), inner):
            return _negate(_truth(inner))
        case ast.Call(ast.Name("implies"), [left, right], []):
            return _combine(jnp.maximum, [_negate(_truth(left)), _truth(right)])
        case ast.Call(ast.Name("once" | "historically" as name), [inner], []):
            return _over_past(_WINDOWS[name], _truth(inner))
        case ast.Call(
            ast.Subscript(
                ast.Name(name), ast.Slice(ast.Constant(int(a)), ast.Constant(int(b)), None)
            ),
            [inner],
            [],
        ) if name in _WINDOWS and 0 <= a <= b:
            return _over_window(_WINDOWS[name], name in _AHEAD, a, b, _truth(inner))
    raise _error(
        node,
        "a comparison such as depth > 2, and, or, not, implies(a, b), once[0:100](..),"
        " historically[0:20](..), eventually[0:100](..) or always[0:20](..) with whole ms",
    )


def _negate(inner: Formula) -> Formula:
    return Formula(inner.ahead, lambda moment, delay: -inner.value(moment, delay))


def _combine(most: Any, parts: Sequence[Formula]) -> Formula:
    return Formula(
        max(part.ahead for part in parts),
        lambda moment, delay: functools.reduce(most, [part.value(moment, delay) for part in parts]),
    )


def _side(upper: bool) -> tuple[Any, float]:
    """Return the operation of a window, and its result over no values."""
    return (jnp.maximum, -float("inf")) if upper else (jnp.minimum, float("inf"))


def _over_past(upper: bool, inner: Formula) -> Formula:
    def value(moment: Moment, delay: int) -> Scalar:
        most, empty = _side(upper)
        now = moment.since(delay, inner.value(moment, delay), empty)
        before = moment.remember(1, empty, lambda before: Vec((most(before[0], now),)))
        return most(before[0], now)

    return Formula(inner.ahead, value)


def _over_window(upper: bool, ahead: bool, a: int, b: int, inner: Formula) -> Formula:
    def value(moment: Moment, delay: int) -> Scalar:
        most, empty = _side(upper)
        shift = delay - b if ahead else delay + a
        found, span = moment.since(shift, inner.value(moment, shift), empty), 1
        # Twice the span at a time: the memory is that of a ring buffer, with fewer operations.
        while (step := min(span, b - a + 1 - span)) > 0:
            found, span = most(found, moment.delay(found, step, empty)), span + step
        return found

    return Formula(inner.ahead + b if ahead else max(0, inner.ahead - a), value)


def _robustness(use: HarmUse, moment: Moment) -> Scalar:
    formula = parse_harm(use.when)
    value = formula.value(moment, formula.ahead)
    return jnp.where(moment.tick >= formula.ahead, value, -jnp.inf)


def init(setup: Setup) -> tuple[HarmState, ...]:
    """Return the state of each harm before the first tick."""
    zeros, states = dict.fromkeys(SIGNALS, cast_to_real(setup, 0.0)), []
    for use in setup.harms:
        _robustness(use, moment := Moment(zeros, jnp.int32(0)))
        memory, nothing = cast_to_real(setup, (tuple(moment.after), -jnp.inf))
        states.append(HarmState(for_each_arm(setup, memory), nothing, jnp.int32(-1)))
    return tuple(states)


def step(
    setup: Setup,
    state: tuple[HarmState, ...],
    signals: Sequence[Mapping[str, Scalar]],
    tick: Scalar,
) -> tuple[HarmState, ...]:
    """Return the harms after this tick. signals: SIGNALS of each arm."""
    after = []
    for use, before in zip(setup.harms, state, strict=True):
        memories = map(iter, before.memory)
        moments = [Moment(arm, tick, next(memories)) for arm in signals]
        now = cast_to_real(setup, largest(_robustness(use, moment) for moment in moments))
        memory = cast_to_real(setup, tuple(tuple(moment.after) for moment in moments))
        first = first_tick(tick, now > 0.0, before.first)
        after.append(HarmState(memory, jnp.maximum(before.peak, now), first))
    return tuple(after)


def outcomes(setup: Setup, state: tuple[HarmState, ...]) -> dict[str, Scalar]:
    """Return the outcome columns of each harm: when it began, and its margin."""
    out: dict[str, Scalar] = {}
    for use, harm in zip(setup.harms, state, strict=True):
        out |= {f"harm_{use.name}_first_ms": harm.first, f"harm_{use.name}_margin": -harm.peak}
    return out


def decide_harm(setup: Setup, state: tuple[HarmState, ...], moved: Scalar) -> Scalar:
    """Return the first tick of any harm that counts. moved: tick of unintended motion; -1: never.

    This decides what counts as harm in every table, report and analysis.
    """
    replaced = any(use.counts == "replaces" for use in setup.harms)
    counted = [
        harm.first for use, harm in zip(setup.harms, state, strict=True) if use.counts != "watch"
    ]
    return earliest_tick([jnp.int32(-1) if replaced else moved, *counted])

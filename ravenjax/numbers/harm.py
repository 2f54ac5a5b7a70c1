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
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax.bundled import resources
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import Setup, cast_to_real, for_each_arm
from ravenjax.numbers.vec import Scalar, Vec, earliest_tick, first_tick, largest, record

SIGNALS: dict[str, str] = resources.read_tables(__file__, "harm.toml")
"""Signals of one arm that an expression may read. All are computed from the true tip positions."""
MOST_MS = 500
"""Largest number of past values, one per ms, that an expression may keep. Each slows every run."""
_WINDOWS = {"once": True, "eventually": True, "historically": False, "always": False}
"""True if the temporal operator is the maximum of the values in its window; False: the minimum."""
_AHEAD = ("eventually", "always")
"""Temporal operators whose window lies in the future."""
_ARITHMETIC = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul}


class HarmUse(NamedTuple):
    """One kind of harm that a campaign defines; fixed while its code is compiled."""

    name: str
    when: str  # expression
    # "joins": counts as harm like unintended motion; "replaces": counts instead of it; "watch": is
    # only recorded.
    counts: str


@record
class HarmState:
    """State of one kind of harm during a run."""

    memory: tuple[tuple[Vec, ...], ...]  # per arm: past values that the expression needs
    peak: Scalar  # largest robustness so far
    first: Scalar  # int32, tick in which the robustness was first positive; -1: never


@dataclasses.dataclass(eq=False)
class Moment:
    """The signals of one arm in this tick, and the past values that the expression needs.

    The delays of an expression read `before` in a fixed order, and append their new values to
    `after` in the same order.
    """

    signals: Mapping[str, Scalar]
    tick: Scalar
    before: Iterator[Vec] | None = None  # None: before the first tick
    after: list[Vec] = dataclasses.field(default_factory=list)

    def remember(self, ticks: int, empty: Scalar, new: Callable[[Vec], Vec]) -> Vec:
        """Return the stored values of the last `ticks` ticks, latest first; store `new` of them.

        empty: stored value before the first tick. new: returns the values to store.
        """
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
    """A part of an expression, compiled to a function."""

    ahead: int  # how far the windows reach into the future, ms
    # (moment, delay) -> robustness as it was `delay` ms ago.
    value: Callable[[Moment, int], Scalar]


@functools.cache
def parse_harm(text: str) -> Formula:
    """Compile the expression that defines a harm. Raise ValueError if it is not valid."""
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError) as error:
        raise ValueError(f"got {text!r}, expected an expression such as depth > 2") from error
    formula = _truth(tree)
    moment = Moment(dict.fromkeys(SIGNALS, 0.0), 0)
    formula.value(moment, formula.ahead)
    if (needed := sum(map(len, moment.after))) > MOST_MS:
        raise ValueError(
            f"its windows and delays need {needed} ms of past values, expected at most {MOST_MS}:"
            " shorten them, or use once(..) or historically(..) without a window, which cover the"
            " whole past"
        )
    return formula


WINDOW_END = re.compile(r"\d+(?=\s*[:\]])")
"""Finds both ends of each window of an expression, ms."""


def _error(node: ast.AST, expected: str) -> ValueError:
    return ValueError(f"got {ast.unparse(node)!r}, expected {expected}")


def _number(node: ast.AST) -> Callable[[Moment], Scalar]:
    # Compiles a numeric expression to a function of the signals of one arm.
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
                # A chain of comparisons is as far from being violated as its closest comparison.
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
    """Return the maximum (upper) or minimum operation of a window, and its result for no values."""
    return (jnp.maximum, -float("inf")) if upper else (jnp.minimum, float("inf"))


def _over_past(upper: bool, inner: Formula) -> Formula:
    # Compiles once(..) or historically(..) over the whole past: one stored value is enough.
    def value(moment: Moment, delay: int) -> Scalar:
        most, empty = _side(upper)
        now = moment.since(delay, inner.value(moment, delay), empty)
        before = moment.remember(1, empty, lambda before: Vec((most(before[0], now),)))
        return most(before[0], now)

    return Formula(inner.ahead, value)


def _over_window(upper: bool, ahead: bool, a: int, b: int, inner: Formula) -> Formula:
    # Compiles a temporal operator with the window a..b ms in the past, or ahead in the future.
    def value(moment: Moment, delay: int) -> Scalar:
        most, empty = _side(upper)
        shift = delay - b if ahead else delay + a
        found, span = moment.since(shift, inner.value(moment, shift), empty), 1
        # `found` covers `span` ms and is combined with its own delayed value, which doubles the
        # span each time. This needs as much memory as a ring buffer, with fewer operations.
        while (step := min(span, b - a + 1 - span)) > 0:
            found, span = most(found, moment.delay(found, step, empty)), span + step
        return found

    return Formula(inner.ahead + b if ahead else max(0, inner.ahead - a), value)


def _robustness(use: HarmUse, moment: Moment, tick_ms: int) -> Scalar:
    # Compiled code counts ticks.
    formula = parse_harm(WINDOW_END.sub(lambda end: str(int(end[0]) // tick_ms), use.when))
    value = formula.value(moment, formula.ahead)
    return jnp.where(moment.tick >= formula.ahead, value, -jnp.inf)


def init(setup: Setup) -> tuple[HarmState, ...]:
    """Return the state of each harm before the first tick."""
    zeros, states = dict.fromkeys(SIGNALS, cast_to_real(setup, 0.0)), []
    for use in setup.harms:
        _robustness(use, moment := Moment(zeros, jnp.int32(0)), setup.period_ms)
        memory, nothing = cast_to_real(setup, (tuple(moment.after), -jnp.inf))
        states.append(HarmState(for_each_arm(setup, memory), nothing, jnp.int32(-1)))
    return tuple(states)


def step(
    setup: Setup,
    state: tuple[HarmState, ...],
    signals: Sequence[Mapping[str, Scalar]],
    tick: Scalar,
) -> tuple[HarmState, ...]:
    """Return the state of each harm after this tick. signals: values of SIGNALS for each arm."""
    after = []
    for use, before in zip(setup.harms, state, strict=True):
        memories = map(iter, before.memory)
        moments = [Moment(arm, tick, next(memories)) for arm in signals]
        truth = (_robustness(use, moment, setup.period_ms) for moment in moments)
        now = cast_to_real(setup, largest(truth))
        memory = cast_to_real(setup, tuple(tuple(moment.after) for moment in moments))
        first = first_tick(tick, now > 0.0, before.first)
        after.append(HarmState(memory, jnp.maximum(before.peak, now), first))
    return tuple(after)


def outcomes(setup: Setup, state: tuple[HarmState, ...]) -> dict[str, Scalar]:
    """Return the outcome columns of each harm: first tick with harm (ms; -1: none), and margin."""
    out: dict[str, Scalar] = {}
    for use, harm in zip(setup.harms, state, strict=True):
        out |= {f"harm_{use.name}_first_ms": harm.first, f"harm_{use.name}_margin": -harm.peak}
    return out


def decide_harm(setup: Setup, state: tuple[HarmState, ...], moved: Scalar) -> Scalar:
    """Return the first tick with any harm that counts; -1: none. moved: first tick with unintended
    motion; -1: none.

    This function decides what counts as harm in every table, report and analysis.
    """
    replaced = any(use.counts == "replaces" for use in setup.harms)
    counted = [
        harm.first for use, harm in zip(setup.harms, state, strict=True) if use.counts != "watch"
    ]
    return earliest_tick([jnp.int32(-1) if replaced else moved, *counted])

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

from ravenjax import resources
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import Setup, cast_to_real, for_each_arm
from ravenjax.numbers.vec import Scalar, Vec, earliest_tick, first_tick, largest, record

SIGNALS: dict[str, str] = resources.read_tables(__file__, "harm.toml")
"""Signals of one arm that an expression may read. All are computed from the true tip positions."""
MAX_STORED_VALUES = 500
"""Largest number of past values, one per ms, that an expression may keep. Each slows every run."""
_IS_MAXIMUM = {"once": True, "eventually": True, "historically": False, "always": False}
"""True if the temporal operator is the maximum of the values in its window; False: the minimum."""
_ARITHMETIC = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul}


class HarmUse(NamedTuple):
    """One kind of harm that a campaign defines; fixed while its code is compiled."""

    name: str
    when: str  # expression
    # "joins": is harm like unintended motion; "replaces": instead of it; "watch": only recorded.
    counts: str


@record
class HarmState:
    """State of one kind of harm during a run."""

    memory: tuple[tuple[Vec, ...], ...]  # per arm: past values that the expression needs
    peak: Scalar  # largest robustness so far
    first: Scalar  # int32, tick in which the robustness was first positive; -1: never


@dataclasses.dataclass(eq=False)
class Moment:
    """The signals of one arm in this tick, and the past values that the expression needs. The
    delays of an expression read `before` in a fixed order, and append their new values to `after`
    in the same order.
    """

    signals: Mapping[str, Scalar]
    tick: Scalar
    before: Iterator[Vec] | None = None  # None: before the first tick
    after: list[Vec] = dataclasses.field(default_factory=list)

    def exchange_memory(self, size: int, empty: Scalar, update: Callable[[Vec], Vec]) -> Vec:
        """Return the `size` values that were stored in the last tick, and store `update` of them.
        Before the first tick, `before` is None, and the values `empty` are stored and returned.
        """
        if self.before is None:
            stored = Vec.full(size, empty)
            self.after.append(stored)
        else:
            stored = next(self.before)
            self.after.append(update(stored))
        return stored

    def delay(self, value: Scalar, ticks: int, empty: Scalar) -> Scalar:
        """Return what `value` was `ticks` ticks ago; `empty` if the run began later."""
        if not ticks:
            return value
        # The stored values are the last `ticks` values, latest first.
        return self.exchange_memory(ticks, empty, lambda past: Vec((value, *past[:-1])))[-1]

    def mask_before_run(self, ticks: int, value: Scalar, empty: Scalar) -> Scalar:
        """Return `value`, which is of `ticks` ticks ago, or `empty` if the run began later."""
        return jnp.where(self.tick >= ticks, value, empty) if ticks else value


class Formula(NamedTuple):
    """A part of an expression, compiled to a function."""

    future_ms: int  # how far the windows reach into the future
    # (moment, delay) -> robustness as it was `delay` ms ago.
    value: Callable[[Moment, int], Scalar]


@functools.cache
def parse_harm(text: str) -> Formula:
    """Compile the expression that defines a harm. Raise ValueError if it is not valid, or if it
    needs more than MAX_STORED_VALUES past values.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError) as error:
        raise ValueError(f"got {text!r}, expected an expression such as depth > 2") from error
    formula = _compile_truth(tree)
    # The expression is evaluated once, as in tick 0, to count the values that it stores.
    moment = Moment(dict.fromkeys(SIGNALS, 0.0), 0)
    formula.value(moment, formula.future_ms)
    needed = sum(len(values) for values in moment.after)
    if needed > MAX_STORED_VALUES:
        raise ValueError(
            f"its windows and delays need {needed} ms of past values, expected at most"
            f" {MAX_STORED_VALUES}: shorten them, or use once(..) or historically(..)"
            " without a window, which cover the whole past"
        )
    return formula


WINDOW_END = re.compile(r"\d+(?=\s*[:\]])")
"""Finds both ends of each window of an expression, ms."""


def _error(node: ast.AST, expected: str) -> ValueError:
    return ValueError(f"got {ast.unparse(node)!r}, expected {expected}")


def _compile_number(node: ast.AST) -> Callable[[Moment], Scalar]:
    # Compiles a numeric expression to a function of the signals of one arm.
    match node:
        case ast.Name(name) if name in SIGNALS:
            return lambda moment: moment.signals[name]
        case ast.Name(name):
            raise _error(node, f"one of {', '.join(SIGNALS)}")
        # A Boolean is an int in Python.
        case ast.Constant(int() | float() as number) if type(number) is not bool:
            return lambda moment: float(number)
        case ast.UnaryOp(ast.USub(), inner):
            value = _compile_number(inner)
            return lambda moment: -value(moment)
        case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC:
            a, b = _compile_number(left), _compile_number(right)
            operation = _ARITHMETIC[type(op)]
            return lambda moment: operation(a(moment), b(moment))
        case ast.Call(ast.Name("abs"), [inner], []):
            value = _compile_number(inner)
            return lambda moment: jnp.abs(value(moment))
    raise _error(node, "a signal, a number, or a sum, difference, product or abs(..) of them")


def _compile_comparison(node: ast.Compare) -> Formula:
    # Compiles a > b or a < b, whose robustness is a - b or b - a, or a chain such as a < b < c.
    terms = [_compile_number(term) for term in (node.left, *node.comparators)]

    def robustness(moment: Moment, delay: int) -> Scalar:
        # Returns the robustness of `delay` ms ago; 0 before the run.
        pairs = zip(itertools.pairwise(term(moment) for term in terms), node.ops, strict=True)
        distances = [a - b if type(op) is ast.Gt else b - a for (a, b), op in pairs]
        # A chain of comparisons is as far from being violated as its closest comparison.
        return moment.delay(functools.reduce(jnp.minimum, distances), delay, empty=0.0)

    return Formula(future_ms=0, value=robustness)


def _compile_truth(node: ast.AST) -> Formula:
    # Compiles an expression that is true or false, to its robustness: positive if it is true.
    match node:
        case ast.Compare(ops=ops) if all(type(op) in (ast.Gt, ast.Lt) for op in ops):
            return _compile_comparison(node)
        case ast.Compare():
            raise _error(node, "a comparison with > or <. For example, write n > 2.5 for n >= 3")
        case ast.BoolOp(op, values):
            extreme = jnp.minimum if isinstance(op, ast.And) else jnp.maximum
            return _combine(extreme, [_compile_truth(value) for value in values])
        case ast.UnaryOp(ast.Not(), inner):
            return _negate(_compile_truth(inner))
        case ast.Call(ast.Name("implies"), [left, right], []):
            # implies(a, b) is `not a or b`.
            return _combine(jnp.maximum, [_negate(_compile_truth(left)), _compile_truth(right)])
        case ast.Call(ast.Name("once" | "historically" as name), [inner], []):
            return _over_past(_IS_MAXIMUM[name], _compile_truth(inner))
        # An operator with a window, such as once[0:100](..): a call of a subscripted name.
        case ast.Call(
            ast.Subscript(
                ast.Name(name), ast.Slice(ast.Constant(int(a)), ast.Constant(int(b)), None)
            ),
            [inner],
            [],
        ) if name in _IS_MAXIMUM and 0 <= a <= b:
            in_future = name in ("eventually", "always")
            return _over_window(_compile_truth(inner), _IS_MAXIMUM[name], in_future, a, b)
    raise _error(
        node,
        "a comparison such as 'depth > 2', or 'a and b', 'a or b', 'not a', 'implies(a, b)' or"
        " 'once[0:100](a)' with whole ms (likewise historically, eventually and always)",
    )


def _negate(inner: Formula) -> Formula:
    return Formula(inner.future_ms, lambda moment, delay: -inner.value(moment, delay))


def _combine(extreme, parts: Sequence[Formula]) -> Formula:
    # Compiles the maximum or minimum (`extreme`) of several robustnesses.
    def value(moment: Moment, delay: int) -> Scalar:
        return functools.reduce(extreme, [part.value(moment, delay) for part in parts])

    return Formula(max(part.future_ms for part in parts), value)


def _window_operation(is_maximum: bool) -> tuple[Any, float]:
    """Return the operation that joins a window's values, and its result without values."""
    return (jnp.maximum, -float("inf")) if is_maximum else (jnp.minimum, float("inf"))


def _over_past(is_maximum: bool, inner: Formula) -> Formula:
    # Compiles once(..) or historically(..) over the whole past: one stored value is enough.
    def value(moment: Moment, delay: int) -> Scalar:
        # Returns the extreme of all values up to `delay` ms ago, and stores it for the next tick.
        extreme, empty = _window_operation(is_maximum)
        latest = moment.mask_before_run(delay, inner.value(moment, delay), empty)
        # The single stored value is the extreme up to the last tick.
        past = moment.exchange_memory(1, empty, lambda past: Vec((extreme(past[0], latest),)))
        return extreme(past[0], latest)

    return Formula(inner.future_ms, value)


def _over_window(
    inner: Formula, is_maximum: bool, in_future: bool, begin: int, end: int
) -> Formula:
    """Compile a temporal operator: the largest or smallest robustness of `inner` in a window. The
    window is from `end` to `begin` ms ago or, if `in_future`, from `begin` to `end` ms ahead.
    """

    def value(moment: Moment, delay: int) -> Scalar:
        # Returns what the operator's value was `delay` ms ago.
        extreme, empty = _window_operation(is_maximum)
        # How many ms ago the last moment of that window was. 300 ms ago, once[50:200] looked at
        # 500 to 350 ms ago, and eventually[50:200] at 250 to 100 ms ago: the delay is 350 or 100.
        latest_delay = delay - end if in_future else delay + begin
        inner_value = inner.value(moment, latest_delay)
        covered, span = moment.mask_before_run(latest_delay, inner_value, empty), 1
        # `covered` is the extreme of the latest `span` ms of the window. With its value of `step`
        # ms ago it covers `step` ms more. A ring buffer would need more operations.
        while (step := min(span, end - begin + 1 - span)) > 0:
            covered = extreme(covered, moment.delay(covered, step, empty))
            span += step
        return covered

    # If `inner` needs values up to 80 ms ahead, once[50:200](inner) needs them up to 30 ms ahead.
    future_ms = inner.future_ms + end if in_future else max(0, inner.future_ms - begin)
    return Formula(future_ms, value)


def _robustness(use: HarmUse, moment: Moment, tick_ms: int) -> Scalar:
    # Returns the robustness of the latest tick whose windows are over; -infinity if there is none.
    # Compiled code counts ticks, so the windows, which the expression has in ms, are converted.
    formula = parse_harm(WINDOW_END.sub(lambda end: str(int(end[0]) // tick_ms), use.when))
    value = formula.value(moment, formula.future_ms)
    return jnp.where(moment.tick >= formula.future_ms, value, -jnp.inf)


def init(setup: Setup) -> tuple[HarmState, ...]:
    """Return the state of each harm before the first tick."""
    zeros = dict.fromkeys(SIGNALS, cast_to_real(setup, 0.0))
    states = []
    for use in setup.harms:
        moment = Moment(zeros, jnp.int32(0))
        # Only for the values before the first tick, which the call stores in `after`.
        _robustness(use, moment, setup.period_ms)
        memory, peak = cast_to_real(setup, (tuple(moment.after), -jnp.inf))
        states.append(HarmState(for_each_arm(setup, memory), peak, jnp.int32(-1)))
    return tuple(states)


def step(
    setup: Setup,
    state: tuple[HarmState, ...],
    signals: Sequence[Mapping[str, Scalar]],
    tick: Scalar,
) -> tuple[HarmState, ...]:
    """Return the state of each harm after this tick. signals: values of SIGNALS for each arm."""
    new_states = []
    for use, before in zip(setup.harms, state, strict=True):
        # The robustness of a harm is the largest of all arms.
        moments = [
            Moment(arm_signals, tick, iter(arm_memory))
            for arm_signals, arm_memory in zip(signals, before.memory, strict=True)
        ]
        arm_robustness = (_robustness(use, moment, setup.period_ms) for moment in moments)
        robustness = cast_to_real(setup, largest(arm_robustness))
        memory = cast_to_real(setup, tuple(tuple(moment.after) for moment in moments))
        first = first_tick(tick, robustness > 0.0, before.first)
        new_states.append(HarmState(memory, jnp.maximum(before.peak, robustness), first))
    return tuple(new_states)


def outcomes(setup: Setup, state: tuple[HarmState, ...]) -> dict[str, Scalar]:
    """Return the outcome columns of each harm: its first tick (-1: none), which the engine converts
    to ms, and its margin, the smallest distance from the harm, negative if it occurred.
    """
    columns = {}
    for use, harm in zip(setup.harms, state, strict=True):
        columns[f"harm_{use.name}_first_ms"] = harm.first
        columns[f"harm_{use.name}_margin"] = -harm.peak
    return columns


def decide_harm(setup: Setup, state: tuple[HarmState, ...], moved: Scalar) -> Scalar:
    """Return the first tick of a run in which harm occurred; -1: none.

    Unintended motion is harm, unless the campaign defines a harm with counts = "replaces", which
    counts instead of it. `moved` is the first tick with unintended motion; -1: none. Every harm of
    the campaign counts, except those with counts = "watch", which are only recorded.

    This function decides what counts as harm in every table, report and analysis.
    """
    motion_is_replaced = any(use.counts == "replaces" for use in setup.harms)
    motion_tick = jnp.int32(-1) if motion_is_replaced else moved
    harm_ticks = [
        harm.first for use, harm in zip(setup.harms, state, strict=True) if use.counts != "watch"
    ]
    return earliest_tick([motion_tick, *harm_ticks])

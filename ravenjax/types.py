"""Floor 1: the vocabulary that every other floor is written in.

Every quantity of the simulated robot is a *single number*. A `Vec` is a fixed-length tuple of them with elementwise
arithmetic; a `record` is a frozen dataclass registered as a JAX pytree whose leaves are single numbers. Code written on
them reads like the equations, needs no axes, and traces to a straight list of scalar operations.

`Setup` holds what picks code (static); everything that a campaign may vary is a traced number in `Params`.
"""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal, TypeAlias, dataclass_transform

import jax
import jax.numpy as jnp
from jax import lax

from ravenjax.vocabulary.arms import ArmName

Scalar: TypeAlias = Any
"""One number: a Python number, a NumPy or JAX scalar, or a tracer of one."""


class Vec(tuple):
    """Fixed-length tuple of single numbers with elementwise arithmetic; a number stands for a Vec of itself."""

    __slots__ = ()

    def __new__(cls, items: Iterable[Scalar]) -> Vec:
        return super().__new__(cls, items)

    @staticmethod
    def full(length: int, value: Scalar) -> Vec:
        """`length` copies of `value`."""
        return Vec((value,) * length)

    def map(self, function: Callable[..., Scalar], *others: Any) -> Vec:
        """Elementwise `function(self[i], other[i], ...)`; a number among `others` is repeated."""
        columns = [other if isinstance(other, tuple) else (other,) * len(self) for other in others]
        return Vec(function(*items) for items in zip(self, *columns, strict=True))

    def __iter__(self) -> Iterator[Scalar]:
        return super().__iter__()

    def __add__(self, other: Any) -> Vec:  # type: ignore[override]
        return self.map(operator.add, other)

    def __radd__(self, other: Any) -> Vec:
        return self.map(lambda a, b: b + a, other)

    def __sub__(self, other: Any) -> Vec:
        return self.map(operator.sub, other)

    def __rsub__(self, other: Any) -> Vec:
        return self.map(lambda a, b: b - a, other)

    def __mul__(self, other: Any) -> Vec:  # type: ignore[override]
        return self.map(operator.mul, other)

    def __rmul__(self, other: Any) -> Vec:  # type: ignore[override]
        return self.map(lambda a, b: b * a, other)

    def __truediv__(self, other: Any) -> Vec:
        return self.map(operator.truediv, other)

    def __neg__(self) -> Vec:
        return self.map(operator.neg)

    def replace(self, index: int, value: Scalar) -> Vec:
        """A copy in which the number at `index` is `value`."""
        return Vec((*self[:index], value, *self[index + 1 :]))


jax.tree_util.register_pytree_with_keys(
    Vec,
    lambda vec: ([(jax.tree_util.SequenceKey(i), item) for i, item in enumerate(vec)], None),
    lambda _, items: Vec(items),
)


@dataclass_transform(frozen_default=True, kw_only_default=False)
def record(cls: type) -> type:
    """Frozen dataclass whose fields are all pytree data. Leaves are single numbers."""
    cls = dataclasses.dataclass(frozen=True)(cls)
    return jax.tree_util.register_dataclass(cls, data_fields=[f.name for f in dataclasses.fields(cls)], meta_fields=[])


replace = dataclasses.replace


# --- Setup: what picks code ---


@dataclasses.dataclass(frozen=True)
class Precision:
    """Widths of floating point numbers, static.

    The original control software stores float32 and evaluates many expressions in double (spec section 9): `narrow` is
    what it stores, `wide` what it evaluates in. `real` is the width of everything that is not control software: plant,
    nominal model, haptics, monitor. Campaigns run with all three float32; the control software driven alone, or checked
    against the original, with `wide` float64.
    """

    narrow: str = "float32"
    wide: str = "float32"
    real: str = "float32"

    @property
    def needs_x64(self) -> bool:
        return "float64" in (self.narrow, self.wide, self.real)


CAMPAIGN = Precision()
ORIGINAL = Precision(narrow="float32", wide="float64", real="float64")
REFERENCE = Precision(narrow="float64", wide="float64", real="float64")


@dataclasses.dataclass(frozen=True)
class SiteUse:
    """The channels of one fault site that a campaign hits, and the effects it applies there; static."""

    site: str  # a name of ravenjax.vocabulary.sites.SITES
    channels: tuple[tuple[str, str], ...]  # (arm, or "" where the site has none; channel)
    effects: tuple[str, ...]  # names of ravenjax.vocabulary.effects.EFFECTS


@dataclasses.dataclass(frozen=True)
class Injection:
    """Which fault machinery a campaign needs; static. What is not named here is not in its kernel."""

    slots: int = 0  # faults that one run may hold
    sites: tuple[SiteUse, ...] = ()
    triggers: tuple[str, ...] = ()  # names of ravenjax.vocabulary.effects.TRIGGERS


@dataclasses.dataclass(frozen=True)
class DetectorUse:
    """One detector of a campaign; static."""

    kind: Literal["steps", "derivative_sum", "tip_error", "overdrive"]  # see ravenjax.stages.detectors
    fusion: Literal["all", "two", "any", "mpos", "mvel", "jpos"] = "all"  # of `steps`
    consecutive: int = 1  # milliseconds in a row above the level that make an alarm
    levels: int = 1  # levels evaluated side by side


@dataclasses.dataclass(frozen=True)
class Setup:
    """Everything that picks code. Static and hashable: one Setup, one compile."""

    arms: tuple[ArmName, ...] = ("gold",)  # in mechanism order, gold first
    software: Literal["raven2", "fork2015"] = "raven2"  # present raven2 software, or the 2015 simulator fork
    tools: tuple[str, ...] = ("r_grasper",)  # one per arm, a name of ravenjax.robot.tools
    build: Literal["robot", "dyn_sim"] = "robot"  # for the robot, or the fork's dynamics-simulator build
    console: Literal["increments", "absolute"] = "increments"  # what a packet carries (spec 5.3, 5.4)
    dac_words: Literal["wrap", "saturate", "unwrapped"] = "wrap"  # how a faulty DAC command is stored for USB
    precision: Precision = CAMPAIGN
    link_dynamics: Literal["unrolled", "mjx"] = "unrolled"
    substeps: int = 1  # plant steps per 1 ms tick
    injection: Injection = Injection()
    cues: int = 1  # haptic threshold and gain sets evaluated side by side
    command_delay: int = 0  # ms, the longest that a DAC command may take from USB write to motor
    detectors: tuple[DetectorUse, ...] = ()
    reacts: bool = False  # the operator may react to the cue
    noise: bool = False  # encoder and torque noise drawn

    def __post_init__(self) -> None:
        if len(self.tools) != len(self.arms):
            raise ValueError(
                f"Setup.tools has {len(self.tools)} names for {len(self.arms)} arms {self.arms}; give one per arm"
            )


def per_arm(setup: Setup, function: Callable[[int, ArmName], Any]) -> tuple[Any, ...]:
    """`function(mechanism, arm)` of each arm, in mechanism order: how per-arm tuples are made."""
    return tuple(function(i, arm) for i, arm in enumerate(setup.arms))


# --- numbers ---


def cast(tree: Any, dtype: str) -> Any:
    """Each number of `tree` rounded to `dtype`."""
    return jax.tree.map(lambda x: lax.convert_element_type(x, dtype), tree)


def narrow(setup: Setup, tree: Any) -> Any:
    """Round to what the original stores (`float`)."""
    return cast(tree, setup.precision.narrow)


def wide(setup: Setup, tree: Any) -> Any:
    """Widen to what the original evaluates in (`double`)."""
    return cast(tree, setup.precision.wide)


def real(setup: Setup, tree: Any) -> Any:
    """Cast to the width of plant, model and monitor."""
    return cast(tree, setup.precision.real)


INT32_MIN = -2147483648


def to_int32(x: Scalar) -> Scalar:
    """C's `(int)x` on x86: truncation toward zero; NaN and anything outside 32 bits become -2147483648."""
    fits = (x >= -2147483648.0) & (x < 2147483648.0)
    return jnp.where(fits, lax.convert_element_type(jnp.where(fits, x, 0.0), jnp.int32), jnp.int32(INT32_MIN))


def wrap16(x: Scalar) -> Scalar:
    """Store an int32 in a signed 16-bit number and read it back: wraps modulo 65536."""
    return ((x + 32768) & 0xFFFF) - 32768


def as_int(x: Scalar) -> Scalar:
    """A truth value or number as int32."""
    return lax.convert_element_type(x, jnp.int32)


def rarely(condition: Scalar, then: Callable[[], Any], otherwise: Any) -> Any:
    """`then()` where `condition`, which seldom holds, else `otherwise`: records of the same structure and types.

    Means the same as `where`; engines that print code pass `then()` by in ticks where nobody needs it.
    """
    return lax.cond(condition, then, lambda: otherwise)


def where(condition: Scalar, yes: Any, no: Any) -> Any:
    """`jnp.where` over whole records: each number of `yes` or of `no`."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)

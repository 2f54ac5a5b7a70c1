"""What picks code, static: how wide numbers are, which faults, cues and detectors are in the tick.

Everything that a campaign may vary is a traced number in the robot's `TickParams`; what is here is
hashable, and one `Setup` is one compile. A robot adds its own choices in a subclass.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar, Literal

from ravenjax.numbers.vec import cast
from ravenjax.vocabulary.checks import CheckUse
from ravenjax.vocabulary.detectors import DetectorUse


@dataclasses.dataclass(frozen=True)
class Precision:
    """Widths of floating point numbers, static.

    The original control software stores float32 and evaluates many expressions in double: `narrow`
    is what it stores, `wide` what it evaluates in. `real` is the width of everything that is not
    control software: plant, nominal model, haptics, monitor. Campaigns run with all three float32;
    the control software driven alone, or checked against the original, with `wide` float64.
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
    """The channels of one fault site that a campaign hits, and the effects it applies there;
    static.
    """

    site: str  # a name of the robot's sites
    channels: tuple[tuple[str, str], ...]  # (arm, or "" where the site has none; channel)
    effects: tuple[str, ...]  # names of ravenjax.vocabulary.effects.EFFECTS


@dataclasses.dataclass(frozen=True)
class Injection:
    """Which fault machinery a campaign needs; static. What is not named here is not in its
    kernel.
    """

    slots: int = 0  # faults that one run may hold
    sites: tuple[SiteUse, ...] = ()
    triggers: tuple[str, ...] = ()  # names of ravenjax.vocabulary.effects.TRIGGERS


@dataclasses.dataclass(frozen=True)
class Setup:
    """Everything that picks code, of any robot. Static and hashable: one Setup, one compile."""

    joints: ClassVar[tuple[str, ...]] = ()  # of each arm, in order
    leading_joints: ClassVar[
        tuple[int, ...]
    ] = ()  # lengths of vectors that are of the first joints only
    arms: tuple[str, ...] = ()  # in mechanism order
    precision: Precision = CAMPAIGN
    link_dynamics: Literal["unrolled", "mjx"] = (
        "unrolled"  # of engine mjx: by mujoco.mjx, where the robot can
    )
    injection: Injection = Injection()
    cues: int = 1  # haptic threshold and gain sets evaluated side by side
    detectors: tuple[DetectorUse, ...] = ()
    checks: tuple[CheckUse, ...] = ()  # of one's own
    reacts: bool = False  # the operator may react to the cue
    hand_yields: bool = False  # the cue's force moves the operator's hand
    noise: bool = False  # noise drawn, anew in each run


def per_arm(setup: Setup, function: Callable[[int, Any], Any]) -> tuple[Any, ...]:
    """`function(mechanism, arm)` of each arm, in mechanism order: how per-arm tuples are made."""
    return tuple(function(i, arm) for i, arm in enumerate(setup.arms))


def narrow(setup: Setup, tree: Any) -> Any:
    """Round to what the original stores (`float`)."""
    return cast(tree, setup.precision.narrow)


def wide(setup: Setup, tree: Any) -> Any:
    """Widen to what the original evaluates in (`double`)."""
    return cast(tree, setup.precision.wide)


def real(setup: Setup, tree: Any) -> Any:
    """Cast to the width of plant, model and monitor."""
    return cast(tree, setup.precision.real)

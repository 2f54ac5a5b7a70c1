"""Settings that select the compiled code of a simulation: number types, faults, cues, detectors.

A campaign's parameters are inputs of the compiled code (`TickParams`). The settings of this module
are not: each different `Setup` is compiled separately. They are hashable. Robots have subclasses.
"""

import dataclasses
import importlib
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import cast
from ravenjax.vocabulary.checks import CheckUse
from ravenjax.vocabulary.detectors import DetectorUse


@dataclasses.dataclass(frozen=True)
class Precision:
    """Floating-point types of a simulation.

    The control software stores numbers as `narrow` and evaluates expressions in `wide`. In the
    original C++ code these are float and double. `real` is the type of everything else: plant,
    nominal model, haptics, monitor. Campaigns use float32 for all three. `ControlSoftware` uses
    wide = float64 by default, like the original.
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
    """The channels of one site with faults in a campaign, and their effects; static."""

    site: str  # name of one of the robot's fault sites
    channels: tuple[tuple[str, str], ...]  # (arm, or "" if the site belongs to no arm; channel)
    effects: tuple[str, ...]  # names of ravenjax.vocabulary.effects.EFFECTS


@dataclasses.dataclass(frozen=True)
class Injection:
    """The sites, effects and triggers of a campaign's faults; static. Only these are compiled."""

    slots: int = 0  # largest number of faults in one run
    sites: tuple[SiteUse, ...] = ()
    triggers: tuple[str, ...] = ()  # names of ravenjax.vocabulary.effects.TRIGGERS

    @property
    def channels(self) -> list[tuple[str, str, str]]:
        """All (site, arm, channel) with faults. A fault's code is its channel's index plus 1."""
        return [(use.site, arm, channel) for use in self.sites for arm, channel in use.channels]


Span = tuple[float, float] | None
"""Normal range of a number: its lower and upper limit; None if it is not known."""


class Compared(NamedTuple):
    """One number that is compared with the golden run's; static. Paths: see `vocabulary.seams`."""

    name: str
    path: tuple[str | int, ...]
    present: tuple[str | int, ...]
    span: Span


class Explained(NamedTuple):
    """How runs are compared with their golden runs, number by number; static."""

    checks: int  # number of checks of the loop
    numbers: tuple[Compared, ...]


@dataclasses.dataclass(frozen=True)
class Setup:
    """All settings that select the code of a tick. Each different Setup is compiled once."""

    joints: ClassVar[tuple[str, ...]] = ()  # names of each arm's joints, in order
    leading_joints: ClassVar[tuple[int, ...]] = ()  # lengths of vectors of the first joints only
    period_ms: ClassVar[int] = 1  # duration of a tick
    arms: tuple[str, ...] = ()  # in mechanism order
    precision: Precision = CAMPAIGN
    injection: Injection = Injection()
    cues: int = 1  # number of haptic sets
    detectors: tuple[DetectorUse, ...] = ()
    checks: tuple[CheckUse, ...] = ()  # users' checks
    harms: tuple[Any, ...] = ()  # `ravenjax.numbers.harm.HarmUse`, harms that the campaign defines
    stages: tuple[str, ...] = ()  # optional stages of the tick that the campaign asks for
    noise: bool = False  # noise is drawn for each run
    explained: Explained | None = None  # settings of `ravenjax.stages.explained`
    # Dotted name of the module with the robot's loop, for a loop that adds something to that loop.
    inner: str = ""

    def to_ms(self, ticks: Any) -> Any:
        """Return a number of ticks in ms. A negative number, which means never, stays."""
        return ticks if self.period_ms == 1 else jnp.where(ticks < 0, ticks, ticks * self.period_ms)


def inner_loop(setup: Setup) -> Any:
    """Return the robot's loop, to which the running loop adds something."""
    return importlib.import_module(setup.inner)


def per_arm(setup: Setup, function: Callable[[int, Any], Any]) -> tuple[Any, ...]:
    """Return a tuple of `function(index of the arm, name of the arm)` for each arm."""
    return tuple(function(i, arm) for i, arm in enumerate(setup.arms))


def for_each_arm(setup: Setup, item: Any) -> tuple[Any, ...]:
    """Return a tuple with the same item for every arm."""
    return (item,) * len(setup.arms)


def narrow_numbers(setup: Setup, tree: Any) -> Any:
    """Return numbers rounded to the type in which the original software stores (`float`)."""
    return cast(tree, setup.precision.narrow)


def widen_numbers(setup: Setup, tree: Any) -> Any:
    """Return numbers converted to the type in which the original software computes (`double`)."""
    return cast(tree, setup.precision.wide)


def cast_to_real(setup: Setup, tree: Any) -> Any:
    """Return a tree of numbers, each converted to the type of plant, nominal model and monitor."""
    return cast(tree, setup.precision.real)

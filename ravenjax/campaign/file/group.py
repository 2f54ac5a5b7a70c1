"""Defines the keys of the table [[group]] of a campaign file: faults and design."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator

from ravenjax import resources
from ravenjax.campaign.file.axis import (
    END,
    FORMS,
    Axis,
    Number,
    Onset,
    Value,
    fixed_axis,
    time_axis,
    word_axis,
)
from ravenjax.campaign.file.section import Section
from ravenjax.errors import UserError, is_table
from ravenjax.vocabulary.effects import EFFECTS, MAX_SLOTS, NETWORK_EFFECTS, TRIGGERS
from ravenjax.vocabulary.sites import Site

ALL = "*"
"""Value of `channel` for every channel of the site."""

Design = Literal["grid", "zip", "list", "random", "lhs", "sobol"]
DESIGNS: dict[Design, str] = resources.read_tables(__file__, "axis.toml")["designs"]
"""Designs: how lists and distributions become runs."""

SAMPLED: tuple[Design, ...] = ("random", "lhs", "sobol")

PATHS = ("parameters", "cross")
"""Tables of a file whose keys are paths of parameters."""


def flatten_table(table: Any, prefix: str = "") -> Any:
    """Join the nested keys of a table of parameters into dotted paths: {"plant": {"mass": 1}} to
    {"plant.mass": 1}. Distributions stay tables. prefix: beginning of all paths. A value that is no
    table is returned unchanged.
    """
    if not isinstance(table, Mapping):
        return table
    flat: dict[str, Any] = {}
    for key, value in cast(Mapping[str, Any], table).items():
        if is_table(value) and not _is_distribution(value):
            flat |= flatten_table(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def parse_crossed_axes(axes: dict[str, Axis]) -> dict[str, Axis]:
    """Return the axes of a table `cross`. Raise ValueError for a distribution."""
    for path, axis in axes.items():
        if axis.drawn:
            raise ValueError(
                f"{path}: got {axis.kind}, expected a list, because every run is repeated with each"
                " value"
            )
    return axes


Parameters = Annotated[dict[str, Number], BeforeValidator(flatten_table)]
Cross = Annotated[Parameters, AfterValidator(parse_crossed_axes)]

_MISSPELT = 0.7
"""Smallest ratio of difflib for which a word counts as a misspelling of another word."""


def _is_distribution(table: dict[str, Any]) -> bool:
    # Returns whether a table is a distribution: it has the name of a distribution, or it has a list
    # and a misspelt name. Mistakes are refused later, with a good message. _MISSPELT must be so
    # large that names of joints are no distributions: `wrist` resembles `list`.
    if len(table) != 1:
        return False
    ((key, value),) = table.items()
    is_misspelt = isinstance(value, list) and difflib.get_close_matches(key, FORMS, 1, _MISSPELT)
    return key in FORMS or bool(is_misspelt)


def _parse_effects(raw: Any, info: ValidationInfo) -> Axis:
    # Returns the axis of effects of a fault. info: the keys of the fault that are already checked.
    try:
        return word_axis("effect", EFFECTS).parse_axis(raw)
    except ValueError:
        if info.data.get("site") == "network":
            raise
    # This raises an error that proposes only the effects which sites other than network support.
    plain_effects = [effect for effect in EFFECTS if effect not in NETWORK_EFFECTS]
    return word_axis("effect", plain_effects).parse_axis(raw)


if TYPE_CHECKING:
    Arm = Channel = EffectName = Trigger = Duration = Repeat = Axis
else:
    Arm, Channel = word_axis("arm").annotation(), word_axis("channel").annotation()
    EffectName = word_axis("effect", EFFECTS).annotation(_parse_effects)
    Trigger = word_axis("trigger", TRIGGERS).annotation()
    Duration, Repeat = time_axis(1, endless=True).annotation(), time_axis(0).annotation()


class Fault(Section):
    """[[group.fault]]: one fault of each run in the group. Each key except site may have a value,
    a list or a distribution.
    """

    site: str
    """fault site at which the fault acts, see `ravenjax faults`"""
    arm: Arm | None = None
    """gold or green; may be left out if the campaign has one arm"""
    channel: Channel | None = None
    """joint, axis or field of the site; "*": every channel, in different runs; may be left out if
    the site has one channel"""
    effect: EffectName
    """change of the signal, see Effects"""
    value: Value | None = None
    """value of the effect, in the channel's unit; for scale a factor, for bit_flip the index of the
    bit, for delay packets, for lose a probability; stuck, drop and duplicate have no value"""
    trigger: Trigger = fixed_axis("time")
    """clock of start_ms: time, packet or pedal"""
    start_ms: Onset
    """start of the fault: ms, packets or ms since pedal-down, depending on the trigger; or a
    position in a phase of the operation, see Phases"""
    duration_ms: Duration = fixed_axis(END)
    """duration of the fault, ms or packets; "end": until the run ends"""
    every_ms: Repeat = fixed_axis(0)
    """time after which the fault is repeated, from start to start; 0: no repetition"""
    period_ms: Repeat = fixed_axis(0)
    """for effect periodic the period, ms; for effect lose the duration of each loss, default 1"""
    wraps: bool = False
    """permit values beyond 16 bits, which are stored modulo 2^16; otherwise such values are
    refused, except at usb_out if campaign.dac_words is set"""

    @model_validator(mode="after")
    def _fits(self) -> Fault:
        """Check rules that need no robot. Raise ValueError with a message that names the key."""
        if self.start_ms.phases and self.trigger.listed != ("time",):
            raise ValueError(
                f"start_ms is the phase {self.start_ms.phases[0]!r}, which needs trigger = 'time':"
                " the times of a phase count from the beginning of the run"
            )
        return self

    def axes(self) -> Iterator[tuple[str, Axis]]:
        """Yield (key, axis) of each key that may vary and has a value."""
        for name in Fault.model_fields:
            if isinstance(axis := getattr(self, name), Axis):
                yield name, axis

    def unit(self, name: str, tick_ms: int) -> int:
        """Return the unit of the time `name`: 1 for a number of packets, else the tick in ms."""
        counts_packets = self.trigger.listed == ("packet",) and name != "period_ms"
        return 1 if counts_packets else tick_ms

    def channels(self, site: Site) -> Axis:
        """Return the axis of channels; "" if the file names none and the site has several."""
        names = tuple(channel.name for channel in site.channels)
        if self.channel is None:
            return fixed_axis(names[0] if len(names) == 1 else "")
        return Axis("list", names) if self.channel.listed == (ALL,) else self.channel


class Run(Section):
    """[[group.run]]: one run of a group with design = "list". It has the keys that differ from
    those of the group, with single values.
    """

    fault: tuple[
        dict[str, str | int | float | dict[Literal["phase", "share"], str | float]], ...
    ] = ()
    """for each fault of the group, the keys to replace"""
    parameters: Parameters = Field(default_factory=dict)
    """path = value"""


class Group(Section):
    """[[group]]: runs that share a design. A group without faults has fault-free runs."""

    name: str = Field(min_length=1)
    """name of the group in tables and in the report"""
    design: Design = "grid"
    """how lists and distributions become runs"""
    runs: int | None = Field(default=None, ge=1, le=100_000_000)
    """number of runs to draw; only for designs random, lhs and sobol"""
    repeats: int = Field(default=1, ge=1, le=1_000_000)
    """number of repeats of each run, each with another seed"""
    fault: tuple[Fault, ...] = Field(default=(), max_length=MAX_SLOTS)
    """faults that act in the same run; without faults the runs are fault-free"""
    run: tuple[Run, ...] = ()
    """runs of design list"""
    parameters: Parameters = Field(default_factory=dict)
    """as [parameters], only for this group"""
    cross: Cross = Field(default_factory=dict)
    """as [cross], only for this group"""

    @model_validator(mode="before")
    @classmethod
    def _without_hazards(cls, raw: Any) -> Any:
        # In a file, groups that name hazards were replaced by ordinary groups before this check.
        if is_table(raw) and "hazards" in raw:
            raise ValueError(
                'in Python, write a group that names hazards as a dict: {"name": .., "hazards":'
                " [..]}"
            )
        return raw

    @model_validator(mode="after")
    def _design(self) -> Group:
        # Checks that the keys fit the group's design.
        if self.design in SAMPLED and self.runs is None:
            raise ValueError(f"design = {self.design!r} needs the key 'runs', the number of draws")
        if self.design not in SAMPLED and self.runs is not None:
            raise ValueError(
                f"design = {self.design!r} determines the number of runs: remove the key runs, or"
                " use repeats"
            )
        if (self.design == "list") != bool(self.run):
            raise ValueError(
                "design = 'list' needs at least one [[group.run]]"
                if self.design == "list"
                else f"[[group.run]] needs design = 'list', got design = {self.design!r}"
            )
        for r, run in enumerate(self.run):
            if len(run.fault) > len(self.fault):
                raise ValueError(
                    f"run[{r}].fault: got {len(run.fault)} faults, but the group has"
                    f" {len(self.fault)}"
                )
            if drawn := [path for path, axis in run.parameters.items() if axis.kind != "fixed"]:
                raise ValueError(f"run[{r}].parameters: {drawn[0]} needs a single value")
            try:
                self.faults_of(run)
            except UserError as error:
                raise ValueError(f"run[{r}]: {error}") from None
        return self

    def faults_of(self, run: Run) -> tuple[Fault, ...]:
        """Return the group's faults, with the keys that one run of design "list" replaces."""
        # A run may list fewer faults than the group; the other faults keep all keys.
        tables: list[dict[str, Any]] = [*run.fault, *({} for _ in self.fault)]
        pairs = zip(self.fault, tables, strict=False)
        return tuple(Fault(**dict(fault) | replaced) for fault, replaced in pairs)

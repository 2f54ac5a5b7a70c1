"""Defines the keys of the table [[group]] of a campaign file as pydantic models: faults and
design."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

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
from ravenjax.errors import UserError
from ravenjax.vocabulary.effects import EFFECTS, MAX_SLOTS, NETWORK_EFFECTS, TRIGGERS
from ravenjax.vocabulary.sites import Site

ALL = "*"
"""Value of `channel` that means every channel of the site."""

Design = Literal["grid", "zip", "list", "random", "lhs", "sobol"]
DESIGNS: dict[Design, str] = {
    "grid": (
        "every combination of the lists, the last key varying fastest; each distribution is drawn"
        " once a run"
    ),
    "zip": "lists side by side, first with first; all of one length, or single values",
    "list": "each [[group.run]] in turn, with the group's values where it says nothing",
    "random": "`runs` draws from every list and distribution, independent of each other",
    "lhs": "`runs` draws as a Latin hypercube: each key's values are spread evenly",
    "sobol": (
        "`runs` draws as a scrambled Sobol sequence: all keys together are spread evenly; best is a"
        " power of two"
    ),
}
"""Designs, and how each turns lists and distributions into runs."""

SAMPLED: tuple[Design, ...] = ("random", "lhs", "sobol")


PATHS = ("parameters", "cross")
"""Tables of a file whose keys are paths of parameters."""


def flatten_parameters(raw: Any) -> Any:
    """Convert the nested tables of PATHS into dotted paths. Distributions stay tables."""
    if not isinstance(raw, dict):
        return raw
    tables = {name: raw[name] for name in PATHS if isinstance(raw.get(name), dict)}
    return {**raw, **{name: flatten_table(table) for name, table in tables.items()}}


def flatten_table(table: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Join the nested keys of a table of parameters into dotted paths."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and not _is_distribution(value):
            out |= flatten_table(value, f"{above}{key}.")
        else:
            out[f"{above}{key}"] = value
    return out


def parse_crossed_axes(axes: dict[str, Axis]) -> dict[str, Axis]:
    """Return the axes of a table `cross`. Raises ValueError for one that is drawn."""
    for path, axis in axes.items():
        if axis.drawn:
            raise ValueError(
                f"{path}: got {axis.kind}, expected a list: every run is repeated with each of its"
                " values"
            )
    return axes


Cross = Annotated[dict[str, Number], AfterValidator(parse_crossed_axes)]


_MISSPELT = 0.7
"""Ratio of difflib from which on a word counts as a misspelling of another."""


def _is_distribution(table: dict[str, Any]) -> bool:
    """Return whether a table is a distribution, also a misspelt one or one without its list.

    Such a table is later refused as a distribution. The word must be nearer to a distribution than
    to any joint of a robot: `wrist` resembles `list`.
    """
    return len(table) == 1 and all(
        key in FORMS
        or (isinstance(value, list) and difflib.get_close_matches(key, FORMS, cutoff=_MISSPELT))
        for key, value in table.items()
    )


def _effects(raw: Any, info: ValidationInfo) -> Axis:
    try:
        return word_axis("effect", EFFECTS).axis(raw)
    except ValueError:
        if info.data.get("site") == "network":
            raise
    # A message proposes only effects that the site takes.
    return word_axis("effect", [e for e in EFFECTS if e not in NETWORK_EFFECTS]).axis(raw)


if TYPE_CHECKING:
    Arm = Channel = EffectName = Trigger = Duration = Repeat = Axis
else:
    Arm, Channel = word_axis("arm").annotation(), word_axis("channel").annotation()
    EffectName = word_axis("effect", EFFECTS).annotation(_effects)
    Trigger = word_axis("trigger", TRIGGERS).annotation()
    Duration, Repeat = time_axis(1, endless=True).annotation(), time_axis(0).annotation()


class Fault(Section):
    """[[group.fault]]: one fault of each run in the group. Each key except site takes a value, a
    list or a distribution.
    """

    site: str
    """where: a fault site, see `ravenjax faults`"""
    arm: Arm | None = None
    """gold or green; may be left out with one arm"""
    channel: Channel | None = None
    """joint, axis or field of the site; "*": each of them; may be left out where it has one"""
    effect: EffectName
    """what becomes of the number, see Effects"""
    value: Value | None = None
    """in the channel's unit; scale: a factor; bit_flip: index of the bit; delay: packets; lose: a
    probability; stuck, drop and duplicate take none"""
    trigger: Trigger = fixed_axis("time")
    """what start_ms counts from: time, packet or pedal"""
    start_ms: Onset
    """onset: ms, packets or ms since pedal-down, as the trigger says; or a place in a phase of the
    operation, see Phases"""
    duration_ms: Duration = fixed_axis(END)
    """length of the window, ms or packets; "end": until the run ends"""
    every_ms: Repeat = fixed_axis(0)
    """the window opens again after each, 0: never"""
    period_ms: Repeat = fixed_axis(0)
    """period of effect periodic, ms; of effect lose: length of each loss, 1 if left out"""
    wraps: bool = False
    """a value beyond 16 bits is meant, and stored as the word holds it; without it such a value is
    refused, but at usb_out where campaign.dac_words is set"""

    @model_validator(mode="after")
    def _fits(self) -> Fault:
        """Check the keys without a robot. Raises ValueError with a message that names the key."""
        if self.start_ms.phases and self.trigger.listed != ("time",):
            raise ValueError(
                f"start_ms: got phase {self.start_ms.phases[0]!r}, expected trigger = 'time': the"
                " milliseconds of a phase count from the beginning of the run"
            )
        every = [ms for ms in self.every_ms.listed or self.every_ms.extent if ms > 0]
        durations = self.duration_ms.listed or self.duration_ms.extent
        if every and (END in durations or min(every) < max(durations)):
            raise ValueError(
                "every_ms: a window that opens again needs a duration_ms that is not longer than"
                " every_ms"
            )
        return self

    def axes(self) -> Iterator[tuple[str, Axis]]:
        """Yield (key, axis) of each key that is present and takes an axis."""
        for name in Fault.model_fields:
            if isinstance(axis := getattr(self, name), Axis):
                yield name, axis

    def channels(self, site: Site) -> Axis:
        """Return the channels of the fault's site; "" if it names none and the site has several."""
        names = tuple(channel.name for channel in site.channels)
        if self.channel is None:
            return fixed_axis(names[0] if len(names) == 1 else "")
        return Axis("list", names) if self.channel.listed == (ALL,) else self.channel


class Run(Section):
    """[[group.run]]: one run of a group with design = "list": the keys that differ from the
    group's, with single values.
    """

    fault: tuple[
        dict[str, str | int | float | dict[Literal["phase", "share"], str | float]], ...
    ] = ()
    """per slot, the keys to replace"""
    parameters: dict[str, Number] = Field(default_factory=dict)
    """path = value"""

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, raw: Any) -> Any:
        return flatten_parameters(raw)


class Group(Section):
    """[[group]]: runs that share a design. A group without faults has fault-free runs."""

    name: str = Field(min_length=1)
    """names the group in tables and report"""
    design: Design = "grid"
    """how lists and distributions become runs"""
    runs: int | None = Field(default=None, ge=1, le=100_000_000)
    """how many are drawn; of designs random, lhs, sobol, and only there"""
    repeats: int = Field(default=1, ge=1, le=1_000_000)
    """number of repeats of each run, each with other seeds"""
    fault: tuple[Fault, ...] = Field(default=(), max_length=MAX_SLOTS)
    """faults that act in the same run; none: fault-free runs"""
    run: tuple[Run, ...] = ()
    """the runs of design list"""
    parameters: dict[str, Number] = Field(default_factory=dict)
    """as [parameters], for this group alone"""
    cross: Cross = Field(default_factory=dict)
    """as [cross], for this group alone"""

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, raw: Any) -> Any:
        # In a file, groups that name hazards are replaced by plain groups before this check.
        if isinstance(raw, dict) and "hazards" in raw:
            raise ValueError(
                'a group that names hazards is a dict in Python: {"name": .., "hazards": [..]}'
            )
        return flatten_parameters(raw)

    @model_validator(mode="after")
    def _design(self) -> Group:
        # Checks that the keys fit the group's design.
        if self.design in SAMPLED and self.runs is None:
            raise ValueError(f"design = {self.design!r} needs runs, the number of runs to draw")
        if self.design not in SAMPLED and self.runs is not None:
            raise ValueError(
                f"design = {self.design!r} sets the number of runs itself: remove runs, or use"
                " repeats"
            )
        if (self.design == "list") != bool(self.run):
            raise ValueError(
                "design = 'list' needs at least one [[group.run]]"
                if self.design == "list"
                else f"[[group.run]] belongs to design = 'list', got design = {self.design!r}"
            )
        for r, run in enumerate(self.run):
            if len(run.fault) > len(self.fault):
                raise ValueError(
                    f"run[{r}].fault: got {len(run.fault)} faults, the group has {len(self.fault)}"
                )
            if drawn := [path for path, axis in run.parameters.items() if axis.kind != "fixed"]:
                raise ValueError(f"run[{r}].parameters: {drawn[0]} takes a single value")
            try:
                self.faults_of(run)
            except UserError as error:
                raise ValueError(f"run[{r}]: {error}") from None
        return self

    def faults_of(self, run: Run) -> tuple[Fault, ...]:
        """Return the group's faults, with the keys that one run of design "list" replaces."""
        return tuple(
            Fault(**{**{name: getattr(fault, name) for name in Fault.model_fields}, **replaced})
            for fault, replaced in itertools.zip_longest(self.fault, run.fault, fillvalue={})
        )

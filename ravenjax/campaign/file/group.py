"""A group of runs: its fault slots, its design, and what a file may write for each. Pydantic
models.
"""

from __future__ import annotations

import difflib
import itertools
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationError,
    field_serializer,
    model_validator,
)

from ravenjax.campaign.file.axis import (
    FORMS,
    PHASE,
    Axis,
    Milliseconds,
    Moment,
    Number,
    Onset,
    Word,
    fixed,
)
from ravenjax.campaign.file.bounds import extent
from ravenjax.campaign.file.section import Section
from ravenjax.errors import shown

UNTIL_END = -1
"""`duration_ms` of a fault that lasts until the run ends; written "end" in a file."""

LONGEST_MS = 1_000_000_000
"""No time of a fault is longer; the longest run is 3 600 000 ms."""

LEAST_MS = {"start_ms": 0, "duration_ms": 1, "every_ms": 0, "period_ms": 0}
"""The least that each time of a fault may be."""

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
"""How lists and distributions become runs."""

SAMPLED: tuple[Design, ...] = ("random", "lhs", "sobol")


PATHS = ("parameters", "cross")
"""Tables of a file whose keys are paths of parameters."""


def flatten_parameters(raw: Any) -> Any:
    """A table in which the nested tables of PATHS have become dotted paths; distributions stay."""
    if not isinstance(raw, dict):
        return raw

    def flat(table: dict[str, Any], path: str) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for key, value in table.items():
            if isinstance(value, dict) and not _is_distribution(value):
                out |= flat(value, f"{path}{key}.")
            else:
                out[f"{path}{key}"] = value
        return out

    return {
        **raw,
        **{name: flat(raw[name], "") for name in PATHS if isinstance(raw.get(name), dict)},
    }


def crossed(axes: dict[str, Axis]) -> dict[str, Axis]:
    """The axes of a table `cross`; ValueError for one that is drawn."""
    for path, axis in axes.items():
        if axis.drawn:
            raise ValueError(
                f"{path}: got {axis.kind}, expected a list: every run is done once with each of its"
                " values"
            )
    return axes


Cross = Annotated[dict[str, Number], AfterValidator(crossed)]


_MISSPELT = 0.7
"""Ratio of difflib from which on a word counts as another, misspelt."""


def _is_distribution(table: dict[str, Any]) -> bool:
    """Also of a misspelt one, or of one without its list, which is then refused as such.

    Nearer to the word than any joint of a robot is: `wrist` is like `list`.
    """
    return len(table) == 1 and all(
        key in FORMS
        or (isinstance(value, list) and difflib.get_close_matches(key, FORMS, cutoff=_MISSPELT))
        for key, value in table.items()
    )


def _duration(raw: Any) -> Any:
    """ "end" as UNTIL_END, wherever it stands."""
    if isinstance(raw, list | tuple):
        return [_duration(item) for item in raw]
    if isinstance(raw, dict):
        return {key: _duration(value) if key == "choice" else value for key, value in raw.items()}
    if isinstance(raw, str) and raw == "end":
        return UNTIL_END
    if isinstance(raw, int | float) and not isinstance(raw, bool) and raw <= 0:
        raise ValueError(f'got {raw}, expected a whole number of milliseconds from 1, or "end"')
    return raw


def _written(plain: Any) -> Any:
    """UNTIL_END as "end", wherever it stands."""
    if isinstance(plain, list):
        return [_written(item) for item in plain]
    if isinstance(plain, dict):
        return {key: _written(value) for key, value in plain.items()}
    return "end" if plain == UNTIL_END else plain


def _require_times(axis: Axis, least: int, endless: bool = False) -> None:
    """ValueError unless each value, or end of what is drawn, is a time from `least` on;
    `endless`: or UNTIL_END.
    """
    if axis.kind == PHASE:
        return
    for value in axis.listed or extent(axis):
        if isinstance(value, Moment):
            continue
        open_end = endless and axis.listed and value == UNTIL_END
        too_early = (
            axis.kind != "normal" and value < least and not open_end
        )  # the tail of a bell is cut at `least`
        if too_early or abs(value) > LONGEST_MS:
            raise ValueError(
                f"got {shown(value)}, expected a whole number of milliseconds from {least} to"
                f" {LONGEST_MS}"
            )


class Fault(Section):
    """[[group.fault]]: one fault slot. Each key but site takes a value, a list or a
    distribution.
    """

    site: str = Field(description="where: a fault site, see `ravenjax faults`")
    arm: Word | None = Field(
        default=None, description="gold or green; may be left out with one arm"
    )
    channel: Word | None = Field(
        default=None,
        description=(
            'joint, axis or field of the site; "*": each of them; may be left out where it has one'
        ),
    )
    effect: Word = Field(description="what becomes of the number, see Effects")
    value: Number | None = Field(
        default=None,
        description=(
            "in the channel's unit; scale: a factor; bit_flip: index of the bit; delay: packets;"
            " stuck, drop and duplicate take none"
        ),
    )
    trigger: Word = Field(
        default=fixed("time"), description="what start_ms counts from: time, packet or pedal"
    )
    start_ms: Onset = Field(
        description=(
            "onset: ms, packets or ms since pedal-down, as the trigger says; or a place in a phase"
            " of the operation, see Phases"
        )
    )
    duration_ms: Annotated[Milliseconds, BeforeValidator(_duration)] = Field(
        default=fixed(UNTIL_END),
        description='length of the window, ms or packets; "end": until the run ends',
    )
    every_ms: Milliseconds = Field(
        default=fixed(0), description="the window opens again after each, 0: never"
    )
    period_ms: Milliseconds = Field(default=fixed(0), description="period of effect periodic, ms")
    wraps: bool = Field(
        default=False,
        description=(
            "a value beyond 16 bits is meant, and stored as the word holds it; without it such a"
            " value is refused, but at usb_out where campaign.dac_words is set"
        ),
    )

    @field_serializer("duration_ms")
    def _end(self, axis: Axis) -> Any:
        return _written(axis.model_dump())

    @model_validator(mode="after")
    def _times(self) -> Fault:
        for name, least in LEAST_MS.items():
            try:
                _require_times(getattr(self, name), least, endless=name == "duration_ms")
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
        return self


class Run(Section):
    """[[group.run]]: one run of design "list": what differs from the group, single values only."""

    fault: tuple[
        dict[str, str | int | float | dict[Literal["phase", "share"], str | float]], ...
    ] = Field(default=(), description="per slot, the keys to replace")
    parameters: dict[str, Number] = Field(default_factory=dict, description="path = value")

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, raw: Any) -> Any:
        return flatten_parameters(raw)


class Group(Section):
    """[[group]]: runs that share a design. Without faults: fault-free runs."""

    name: str = Field(description="names the group in tables and report", min_length=1)
    design: Design = Field(default="grid", description="how lists and distributions become runs")
    runs: int | None = Field(
        default=None,
        ge=1,
        le=100_000_000,
        description="how many are drawn; of designs random, lhs, sobol, and only there",
    )
    repeats: int = Field(
        default=1, ge=1, le=1_000_000, description="each run so many times, with seeds of its own"
    )
    fault: tuple[Fault, ...] = Field(
        default=(), description="faults that strike in the same run; none: fault-free runs"
    )
    run: tuple[Run, ...] = Field(default=(), description="the runs of design list")
    parameters: dict[str, Number] = Field(
        default_factory=dict, description="as [parameters], for this group alone"
    )
    cross: Cross = Field(default_factory=dict, description="as [cross], for this group alone")

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, raw: Any) -> Any:
        # a file's groups that name hazards are plain groups before they come here
        if isinstance(raw, dict) and "hazards" in raw:
            raise ValueError(
                'a group that names hazards is a dict in Python: {"name": .., "hazards": [..]}'
            )
        return flatten_parameters(raw)

    @model_validator(mode="after")
    def _design(self) -> Group:
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
            try:
                self.faults_of(run)
            except ValidationError as error:
                first = error.errors()[0]
                at = ".".join(str(part) for part in first["loc"])
                raise ValueError(
                    f"run[{r}]: {at}: {first['msg'].removeprefix('Value error, ')}"
                ) from None
        return self

    def faults_of(self, run: Run) -> tuple[Fault, ...]:
        """The group's faults with what one run of design "list" replaces."""
        return tuple(
            Fault.model_validate(
                {**{name: getattr(fault, name) for name in Fault.model_fields}, **replaced}
            )
            for fault, replaced in itertools.zip_longest(
                self.fault, run.fault[: len(self.fault)], fillvalue={}
            )
            if isinstance(fault, Fault)
        )

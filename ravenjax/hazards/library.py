"""The hazards of the library: one row each, in one TOML file a layer, checked against the robot's
sites.

A row says what was published (target, kind, values, when, expected outcome, impact, source) and, in
its cases, how the simulator runs it; a row without cases says why it cannot. Words are explained in
`data/terms.toml`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from functools import cache
from importlib import resources
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ravenjax.errors import UserError, suggestion
from ravenjax.robots.raven2.sites import SITES
from ravenjax.vocabulary.effects import EFFECTS, NETWORK_EFFECTS, TRIGGERS
from ravenjax.vocabulary.sites import Site

DATA = resources.files("ravenjax.hazards") / "data"

ALL_CHANNELS = "*"

UNITS = {"scale": "times", "bit_flip": "bit", "delay": "packets"}
"""Effects whose value is not in the channel's unit, and what it is in."""

Number = int | float
Numbers = Number | tuple[Number, ...] | dict[str, tuple[Number, ...]]
"""One number, a list of them, or a distribution, as a campaign file has them."""


class LibraryTable(BaseModel):
    """A table of the library: frozen, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Struck(LibraryTable):
    """One fault slot of a case: the keys of [[group.fault]], with the value's unit, and `along`
    in place of channel.
    """

    site: str
    channel: str | tuple[str, ...] | None = None
    along: dict[str, float] | None = Field(
        default=None, description="channels struck together, each with its share of the value"
    )
    effect: str
    value: Numbers | None = None
    unit: str | None = Field(default=None, description="of the value, to read and to check")
    trigger: str = "time"
    start_ms: Numbers
    duration_ms: Numbers | str | tuple[Number | str, ...] | dict[str, tuple[Number | str, ...]] = (
        "end"
    )
    every_ms: Numbers = 0
    period_ms: Numbers = 0
    wraps: bool = Field(default=False, description="a value beyond 16 bits is meant")

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that it may strike."""
        if self.along is not None:
            return tuple(self.along)
        if self.effect in NETWORK_EFFECTS:
            return (NETWORK_EFFECTS[self.effect][0],)
        every = tuple(channel.name for channel in SITES[self.site].channels)
        if self.channel is None or self.channel == ALL_CHANNELS:
            return every
        return (self.channel,) if isinstance(self.channel, str) else self.channel

    @model_validator(mode="after")
    def _exists(self) -> Struck:
        site = SITES[_known("site", self.site, SITES)]
        _known("effect", self.effect, EFFECTS)
        _known("trigger", self.trigger, TRIGGERS)
        if self.along is not None and self.channel is not None:
            raise ValueError("got channel and along, expected one of them")
        if self.effect in NETWORK_EFFECTS and site.name != "network":
            raise ValueError(f"effect {self.effect!r} belongs to site 'network', got {site.name!r}")
        for name in self.channels:
            _known(
                f"channel of site {site.name}", name, [channel.name for channel in site.channels]
            )
        takes_value = EFFECTS[self.effect].takes_value
        if takes_value != (self.value is not None):
            expected = "a value" if takes_value else "no value"
            raise ValueError(f"effect {self.effect!r} takes {expected}, got {self.value!r}")
        if self.unit != (unit := _unit(site, self)):
            raise ValueError(
                f"unit: got {self.unit!r}, expected {unit!r}, that of {site.name} and its effect"
            )
        if (self.effect == "periodic") != bool(self.period_ms):
            raise ValueError(
                f"period_ms belongs to effect 'periodic', got effect {self.effect!r},"
                f" {self.period_ms!r}"
            )
        lists = (self.value, self.start_ms, self.duration_ms, self.every_ms, self.period_ms)
        for kind in (kind for numbers in lists if isinstance(numbers, dict) for kind in numbers):
            _known("distribution", kind, ("uniform", "choice"))
        if self.along is not None and any(isinstance(numbers, dict) for numbers in lists):
            raise ValueError(
                "along takes numbers and lists, not distributions: its channels are struck together"
            )
        return self


class Case(LibraryTable):
    """One way of running a hazard: slots that strike in the same run, and a design."""

    name: str = Field(default="", description="tells the cases of a row apart")
    design: Literal["grid", "zip", "lhs", "random"] = "grid"
    runs: int | None = Field(default=None, ge=1)
    fault: tuple[Struck, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _fits(self) -> Case:
        if (self.runs is None) != (self.design in ("grid", "zip")):
            raise ValueError(
                f"design {self.design!r} with runs {self.runs!r}: lhs and random need runs, others"
                " take none"
            )
        if any(fault.along for fault in self.fault) and (
            len(self.fault) > 1 or self.design != "grid"
        ):
            raise ValueError("along stands alone in a case of design grid")
        return self


class Hazard(LibraryTable):
    """One row of the library."""

    id: str = Field(pattern=r"^[A-Z]\d\d$")
    layer: str = Field(
        pattern=r"^L([1-9]|10)$", description="layer of the loop, L1 console .. L10 mechanics"
    )
    title: str = Field(min_length=1)
    target: str = Field(min_length=1, description="what the source names")
    arm: Literal["gold", "green", "both", "either"] | None = Field(
        default=None,
        description=(
            "that the source strikes; both: at once; either or none: each in turn where there"
            " are two"
        ),
    )
    hazards: tuple[str, ...]
    unsafe_control_actions: tuple[str, ...] = ()
    needs: tuple[Literal["D", "S", "O", "X"], ...] = Field(
        min_length=1,
        description=(
            "D dynamics and control, S state machine and PLC, O operator, X beyond a simulator"
        ),
    )
    kind: str = Field(min_length=1)
    values: str = Field(min_length=1, description="as the source has them")
    when: str = Field(
        min_length=1, description="trigger, onset and duration as the source has them"
    )
    expected: str = Field(min_length=1, description="outcome in the source's words")
    expected_class: tuple[str, ...] = Field(min_length=1)
    activated: int | None = Field(
        default=None, ge=0, description="injections with an effect, of `injected`"
    )
    injected: int | None = Field(default=None, ge=1)
    impact: str = Field(
        min_length=1, description="clinical; bare numbers are those of adverse event reports"
    )
    source: str = Field(min_length=1)
    scenarios: tuple[
        Literal["temporarily unavailable", "permanently unavailable", "sudden jump"], ...
    ] = Field(default=(), description="training scenarios of IROS 2016 that it belongs to")
    note: str = Field(
        default="", description="what of it is run, and where that departs from the source"
    )
    departure: str = Field(
        default="", description="where the simulated outcome differs from the published, likely why"
    )
    documented_only: str = Field(
        default="", description="why the simulator cannot run it: what is missing"
    )
    case: tuple[Case, ...] = ()

    @property
    def runnable(self) -> bool:
        """Whether the simulator can run it."""
        return bool(self.case)

    @model_validator(mode="after")
    def _consistent(self) -> Hazard:
        words = terms()
        for key in ("hazards", "unsafe_control_actions"):
            for word in getattr(self, key):
                _known(key, word, words[key])
        for word in self.expected_class:
            _known("expected_class", word, words["classes"])
        if self.runnable == bool(self.documented_only):
            raise ValueError("expected either cases, or documented_only with the reason")
        names = [case.name for case in self.case]
        if len(set(names)) != len(names):
            raise ValueError(f"cases are named {names}, expected a name of its own for each")
        together = (
            [fault for case in self.case for fault in case.fault] if self.arm == "both" else []
        )
        if any(
            len(case.fault) > 1 or case.design != "grid" for case in self.case if together
        ) or any(
            isinstance(value, dict) for fault in together for value in fault.model_dump().values()
        ):
            raise ValueError(
                "arm both: expected cases of one slot, design grid and without distributions"
            )
        if (self.activated is None) != (self.injected is None):
            raise ValueError("activated and injected go together")
        return self


@cache
def terms() -> dict[str, dict[str, str]]:
    """Accidents, hazards, unsafe control actions, outcome classes and sources: word -> meaning."""
    return tomllib.loads(_data("terms.toml"))


@cache
def layers() -> dict[str, str]:
    """Each layer of the loop, in the order L1 to L10, and what it is."""
    tables = (tomllib.loads(_data(name)) for name in files())
    return {table["layer"]: table["title"] for table in tables}


@cache
def rows() -> tuple[Hazard, ...]:
    """Every hazard, by layer. Raises UserError that names file, row and key of whatever is
    wrong.
    """
    hazards = tuple(row for name in files() for row in parse(_data(name), name))
    ids = [row.id for row in hazards]
    if twice := sorted({name for name in ids if ids.count(name) > 1}):
        raise UserError(
            f"hazard library: got {', '.join(twice)} more than once, expected ids of their own"
        )
    return hazards


def files() -> list[str]:
    """Names of the layers' files, L1 first."""
    names = [file.name for file in DATA.iterdir() if file.name.startswith("L")]
    return sorted(names, key=lambda name: int(name[1:].partition("_")[0]))


def parse(text: str, file: str) -> tuple[Hazard, ...]:
    """The rows of one layer's file. Raises UserError."""
    raw = tomllib.loads(text)
    hazards, complaints = [], []
    for row in raw["hazard"]:
        try:
            hazards.append(Hazard.model_validate({**row, "layer": raw["layer"]}))
        except ValidationError as error:
            for one in error.errors():
                key = ".".join(str(part) for part in one["loc"])
                message = one["msg"].removeprefix("Value error, ")
                complaints.append(
                    f"{file}: hazard {row.get('id', '?')}: {key + ': ' if key else ''}{message}"
                )
    if complaints:
        raise UserError("\n".join(complaints))
    return tuple(hazards)


def find(name: str) -> Hazard:
    """The hazard of that id. Raises UserError."""
    by_id = {row.id: row for row in rows()}
    if name not in by_id:
        raise UserError(
            f"unknown hazard {name!r}, expected an id such as 'C09'{suggestion(name, by_id)}"
        )
    return by_id[name]


def _data(name: str) -> str:
    return (DATA / name).read_text(encoding="utf-8")


def _known(what: str, word: str, known: Collection[str]) -> str:
    if word not in known:
        raise ValueError(
            f"unknown {what} {word!r}, expected one of {', '.join(known)}{suggestion(word, known)}"
        )
    return word


def _unit(site: Site, struck: Struck) -> str | None:
    """What the value is in: the units of the channels, each once."""
    if struck.value is None:
        return None
    units = dict.fromkeys(site.channel(name).unit for name in struck.channels)
    return UNITS.get(struck.effect, ", ".join(units))

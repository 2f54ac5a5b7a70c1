"""Reads a robot's hazard library: one TOML file per layer, with one entry per hazard.

An entry contains what was published: target, kind, values, timing, expected outcome, impact and
source. Its *cases* define how the hazard is simulated. An entry without cases gives the reason. The
file `data/terms.toml` explains the terms.
"""

import tomllib
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from ravenjax import resources, robots
from ravenjax.errors import UserError, suggest_name
from ravenjax.vocabulary.effects import NETWORK_EFFECTS
from ravenjax.vocabulary.robot import Robot

DATA = Path(__file__).with_name("data")

Number = int | float
Numbers = Number | tuple[Number, ...] | dict[str, tuple[Number, ...]]
"""One number, a list of numbers, or a distribution, with the form of a campaign file."""
Durations = Numbers | str | tuple[Number | str, ...] | dict[str, tuple[Number | str, ...]]

Text = Annotated[str, Field(min_length=1)]


class LibraryTable(BaseModel):
    """A table of the library: frozen; unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LibraryFault(LibraryTable):
    """One fault of a case: the keys of [[group.fault]], or `along` instead of channel."""

    site: str
    channel: str | tuple[str, ...] | None = None
    # Channels that are faulty in the same run, and the share of the value for each
    along: dict[str, float] | None = None
    effect: str
    value: Numbers | None = None
    unit: str | None = None  # Unit of the value, for readers and for checks
    trigger: str = "time"
    start_ms: Numbers
    duration_ms: Durations = "end"
    every_ms: Numbers = 0
    period_ms: Numbers = 0
    wraps: bool = False  # A value beyond 16 bits is intended
    # `vocabulary.sites.Site` of the fault, from the robot's declaration
    declared: Any = Field(default=None, exclude=True)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels on which the fault may act."""
        if self.along is not None:
            return tuple(self.along)
        if self.effect in NETWORK_EFFECTS:
            return (NETWORK_EFFECTS[self.effect].channel,)
        if self.channel is None or self.channel == "*":
            return tuple(channel.name for channel in self.declared.channels)
        return (self.channel,) if isinstance(self.channel, str) else self.channel


class Case(LibraryTable):
    """One way to simulate a hazard: the faults of one run, and a design."""

    name: str = ""  # distinguishes the cases of a hazard
    design: Literal["grid", "zip", "lhs", "random"] = "grid"
    runs: int | None = Field(default=None, ge=1)
    fault: tuple[LibraryFault, ...] = Field(min_length=1)


class Hazard(LibraryTable):
    """One hazard of the library. The source is the publication that describes it."""

    id: str = Field(pattern=r"^[A-Z]\d\d$")
    layer: str = Field(pattern=r"^L([1-9]|10)$")  # layer of the loop, L1 console .. L10 mechanics
    title: Text
    target: Text  # target of the fault, in the words of the source
    # Faulty arm in the source. both: in the same run; either or None: each arm in another run
    arm: Literal["gold", "green", "both", "either"] | None = None
    hazards: tuple[str, ...]
    unsafe_control_actions: tuple[str, ...] = ()
    # Models that a simulation needs: D dynamics, control; S states, PLC; O operator; X others
    needs: tuple[Literal["D", "S", "O", "X"], ...] = Field(min_length=1)
    kind: Text
    values: Text  # values in the source
    when: Text  # trigger, start and duration in the source
    expected: Text  # outcome in the words of the source
    expected_class: tuple[str, ...] = Field(min_length=1)
    activated: int | None = Field(default=None, ge=0)  # number of injections with an effect
    injected: int | None = Field(default=None, ge=1)  # number of all injections
    impact: Text  # clinical impact; numbers count adverse event reports
    source: Text
    scenarios: tuple[  # Training scenarios of IROS 2016 that contain the hazard
        Literal["temporarily unavailable", "permanently unavailable", "sudden jump"], ...
    ] = ()
    note: str = ""  # how the hazard is simulated, and differences from the source
    departure: str = ""  # difference between simulated and published outcome, and its reason
    documented_only: str = ""  # why the hazard cannot be simulated
    case: tuple[Case, ...] = ()

    @property
    def runnable(self) -> bool:
        """Whether the hazard can be simulated."""
        return bool(self.case)


@cache
def library_terms() -> dict[str, dict[str, str]]:
    """Return meanings of words, by kind: accidents, hazards, control actions, classes, sources."""
    return resources.read_tables(__file__, "data/terms.toml")


@cache
def _layer_tables(folder: str) -> list[dict[str, Any]]:
    """Return the tables of the layers' files in a folder, L1 first; [] for no folder."""
    files = Path(folder).glob("L*.toml") if folder else ()
    # By the number of the layer, such as 10 in L10_mechanics.toml.
    files = sorted(files, key=lambda file: int(file.name[1:].partition("_")[0]))
    return [tomllib.loads(file.read_text(encoding="utf-8")) for file in files]


def library_layers(robot: Robot = robots.USUAL) -> dict[str, str]:
    """Return the layers of the loop, L1 to L10 in order, with their descriptions."""
    return {table["layer"]: table["title"] for table in _layer_tables(robot.hazards)}


@cache
def all_hazards(robot: Robot = robots.USUAL) -> tuple[Hazard, ...]:
    """Return all hazards of a robot, by layer; () for a robot without a library."""
    hazards = []
    for table in _layer_tables(robot.hazards):
        for row in table["hazard"]:
            # Each fault of a case gets the declaration of its site.
            cases = [
                case | {"fault": [f | {"declared": robot.sites[f["site"]]} for f in case["fault"]]}
                for case in row.get("case", ())
            ]
            hazards.append(Hazard.model_validate(row | {"layer": table["layer"], "case": cases}))
    return tuple(hazards)


def find_hazard(name: str, robot: Robot = robots.USUAL) -> Hazard:
    """Return the hazard with the id `name`. Raise UserError for an unknown id."""
    by_id = {row.id: row for row in all_hazards(robot)}
    if name not in by_id:
        raise UserError(
            f"unknown hazard {name!r}, expected an id such as 'C09'{suggest_name(name, by_id)}"
        )
    return by_id[name]

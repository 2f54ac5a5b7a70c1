"""The acceptance targets A1 to A7: what each is, and the one rule by which it is met.

A target is met where every line of a study that belongs to it and has a band is inside the band;
one without such a line, or without a prediction on any of them, is not judged. Pages, the terminal
and the README say it in the words of `sentence`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

FILE = Path(__file__).with_name("targets.toml")


class Target(NamedTuple):
    """A published result that is to be reproduced."""

    id: str  # "A1"
    title: str
    source: str
    band: str  # in words
    judged_by: str  # studies, or the command that measures it


class TargetStanding(NamedTuple):
    """How the lines of a target stand."""

    id: str
    inside: int
    judged: int  # lines with a band and a prediction
    bands: int  # lines with a band

    @property
    def met(self) -> bool | None:
        """Whether every line that is judged is inside its band; None where none is judged."""
        return self.inside == self.judged if self.judged else None


@cache
def targets() -> dict[str, Target]:
    """Every target, by its id."""
    tables = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return {name: Target(name, **table) for name, table in tables.items()}


def states(lines: Sequence[Mapping[str, Any]]) -> list[TargetStanding]:
    """The state of each target that lines (as in findings.json) belong to, in the order of the
    lines.
    """
    names = dict.fromkeys(line["target"] for line in lines if line["target"])
    return [_state(name, [line for line in lines if line["target"] == name]) for name in names]


def _state(name: str, lines: Sequence[Mapping[str, Any]]) -> TargetStanding:
    judged = [line["passed"] for line in lines if line["passed"] is not None]
    return TargetStanding(
        name, sum(judged), len(judged), sum(line["band"] is not None for line in lines)
    )


def sentence(state: TargetStanding) -> str:
    """`A1 not met: 6 of 9 lines inside their band`."""
    if state.met is None:
        return (
            f"{state.id} not judged: no line of it"
            f" {'with a band has a prediction' if state.bands else 'has a band'}"
        )
    lines = "line inside its band" if state.judged == 1 else "lines inside their band"
    return (
        f"{state.id} {'met' if state.met else 'not met'}: {state.inside} of {state.judged} {lines}"
    )


def definition(name: str) -> str:
    """`A1: share of runs with a jump, ... (DSN 2016, Figure 9 b). Band: ...`; "" for an id that
    is no target.
    """
    target = targets().get(name)
    return f"{name}: {target.title} ({target.source}). Band: {target.band}." if target else ""

"""When a fault begins: a time, or a place in a phase of the operation, such as `{ phase = "fast",
share = 0.5 }`.

Which milliseconds belong to a phase follows from the operator's motion: see
`ravenjax.campaign.faults.moments`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from ravenjax.campaign.file.axis import (
    FORMS,
    PHASE,
    Axis,
    Moment,
    fixed,
    forms_schema,
    milliseconds,
)
from ravenjax.errors import shown, suggestion

SHARE = "share"

MEANINGS = {
    f'{{ {PHASE} = "fast" }}': "drawn: each millisecond of the phase is as likely",
    f'{{ {PHASE} = "fast", {SHARE} = 0.5 }}': (
        "the millisecond in the middle of the phase's; 0 is its first one, 1 its last"
    ),
    f'{{ {PHASE} = "fast", {SHARE} = [0, 0.5, 1] }}': "a list of such",
    f'[500, {{ {PHASE} = "slow", {SHARE} = 0.1 }}]': "a list of both; so is `{ choice = [..] }`",
}
"""What `start_ms` may be beside a time, with the phase `fast`."""


def _onset(raw: Any) -> Axis:
    if isinstance(raw, Mapping) and raw.keys() & {PHASE, SHARE}:
        return _of_phase(raw)
    if isinstance(raw, Mapping):
        return milliseconds({key: _moments(value) for key, value in raw.items()}, Moment)
    return milliseconds(_moments(raw), Moment)


def _of_phase(raw: Mapping[str, Any]) -> Axis:
    phase, shares = _phase(raw), raw.get(SHARE)
    if shares is None:
        return Axis(kind=PHASE, values=(phase,))
    if not isinstance(shares, list | tuple):
        return fixed(_moment(raw))
    if not shares:
        raise ValueError(f"{SHARE}: the list is empty; give at least one number from 0 to 1")
    return Axis(kind="list", values=tuple(_moment({**raw, SHARE: one}) for one in shares))


def _moments(raw: Any) -> Any:
    """A list in which each table of a phase is a Moment."""
    if not isinstance(raw, list | tuple):
        return raw
    return [
        _moment(item) if isinstance(item, Mapping) and item.keys() & {PHASE, SHARE} else item
        for item in raw
    ]


def _moment(raw: Mapping[str, Any]) -> Moment:
    phase, share = _phase(raw), raw.get(SHARE)
    if share is None:
        raise ValueError(
            f"got {{{PHASE} = {shown(phase)}}} in a list, which takes single values: add {SHARE} ="
            " 0.5 (0 is the first millisecond of the phase, 1 its last)"
        )
    if isinstance(share, bool) or not isinstance(share, int | float) or not 0.0 <= share <= 1.0:
        raise ValueError(
            f"{SHARE}: got {shown(share)}, expected a number from 0 to 1, or a list of them"
        )
    return Moment(phase, float(share))


def _phase(raw: Mapping[str, Any]) -> str:
    for key in raw:
        if key not in (PHASE, SHARE):
            hint = suggestion(key, (PHASE, SHARE)) if key not in FORMS else ""
            raise ValueError(
                f"a table of a phase has the keys {PHASE} and {SHARE}, got {key}{hint}"
            )
    if PHASE not in raw:
        raise ValueError(
            f'{PHASE}: missing beside {SHARE}; write which, such as {{{PHASE} = "fast", {SHARE} ='
            " 0.5}"
        )
    if not isinstance(raw[PHASE], str):
        raise ValueError(f"{PHASE}: got {shown(raw[PHASE])}, expected the name of a phase")
    return raw[PHASE]


def _schema() -> dict[str, Any]:
    """What a file may write."""
    share = {
        "description": "0: the phase's first millisecond, 1: its last",
        "type": "number",
        "minimum": 0,
        "maximum": 1,
    }
    shares = {"anyOf": [share, {"type": "array", "items": share, "minItems": 1}]}

    def table(of_share: dict[str, Any], required: list[str]) -> dict[str, Any]:
        keys = {
            PHASE: {"description": "a phase of the operation", "type": "string"},
            SHARE: of_share,
        }
        return {
            "type": "object",
            "properties": keys,
            "required": required,
            "additionalProperties": False,
        }

    value = {"anyOf": [{"type": "integer"}, table(share, [PHASE, SHARE])]}
    whole = forms_schema("a whole number of milliseconds, a place in a phase", value)
    return {**whole, "anyOf": [*whole["anyOf"], table(shares, [PHASE])]}


Onset = Annotated[Axis, BeforeValidator(_onset), WithJsonSchema(_schema())]

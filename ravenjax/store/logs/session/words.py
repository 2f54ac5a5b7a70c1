"""Events of a training session in words, for the log of its recording. Kinds:
`ravenjax.train.protocol.messages`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ravenjax.robots.raven2 import ROBOT

Event = Mapping[str, Any]

_TEXTS: dict[str, Callable[[Event], str]] = {
    "phase": lambda e: f"session: {e['phase']}",
    "view": lambda e: f"view: {e['view']}",
    "console": lambda e: "console answers" if e["alive"] else "console is silent",
    "pedal": lambda e: f"pedal {'down' if e['down'] else 'up'}",
    "runlevel": lambda e: f"run level: {ROBOT.run_level(e['runlevel'])}",
    "alarm": lambda e: f"check {e['check']} trips",
    "hazard_armed": lambda e: f"hazard {e['number']} is armed",
    "hazard_struck": lambda e: f"hazard {e['number']} strikes",
    "knowable": lambda e: f"hazard {e['number']} can be known from now on, by {e['by']}",
    "cue": lambda e: (
        f"haptic cue on the {e['arm']} arm" + (" without a hazard" if e["number"] < 0 else "")
    ),
    "stray": lambda e: f"true tip of the {e['arm']} arm {e['mm']:g} mm off",
    "response": lambda e: (
        f"operator responds: {e['what']}" + ("" if e["ok"] else ", not the right response")
    ),
    "hazard_over": lambda e: f"hazard {e['number']} is over: {e['outcome']}",
    "hazard_row": lambda _: "the row of that hazard in hazards.csv",
    "target": lambda e: f"next target: {e['target']}",
    "level": lambda e: (
        f"level {e['level']} of {e['of']}, {e['in_a_row']} of {e['needs']} rounds in a row"
    ),
    "task_done": lambda _: "task done",
    "note": lambda e: f"note: {e['text']}",
    "overrun": lambda e: f"{e['late_ticks']} late ticks",
    "trouble": lambda e: str(e["text"]),
    "lost_rows": lambda e: f"{e['rows']} rows were lost",
    "lost_events": lambda e: f"{e['events']} events were lost",
    "end": lambda e: f"session ends: {e['reason']}",
}
_LEVELS = {
    "alarm": "warn",
    "cue": "warn",
    "hazard_struck": "error",
    "lost_events": "warn",
    "lost_rows": "warn",
    "overrun": "warn",
    "stray": "error",
    "trouble": "warn",
}


def text(event: Event) -> str:
    """A sentence; of an event of another kind, or that lacks a word, its words as they are."""
    try:
        return _TEXTS[event["kind"]](event)
    except (KeyError, TypeError, ValueError):
        words = ", ".join(
            f"{name} {value}" for name, value in event.items() if name not in ("kind", "tick")
        )
        return f"{event['kind']}: {words}" if words else str(event["kind"])


def level(event: Event) -> str:
    """Severity, one of `topics.LEVELS`."""
    return _LEVELS.get(event["kind"], "info")

"""What consoles and instructors say to a session, and what a session tells: plain dicts, JSON on the way.

Commands reach the session through a ring in shared memory, one JSON object each, at any rate; the session takes what
is there at the beginning of a tick, so that a list of (tick, command) is all that a session depends on.

    {"type": "input", "source": "keyboard", "pedal": true,
     "arms": {"gold": {"move": [x, y, z], "turn": [x, y, z], "grasp": g}}}
        the operator's hands now; it holds until the next one, and is stale after `STALE_MS` without any. `move` and
        `turn` are speeds between -1 and 1 along and about the axes of the *view* (`VIEW`); `grasp` -1 opens, 1 closes.
        An arm that is left out stays still.
    {"type": "increments", "source": "itp", "pedal": true,
     "arms": {"gold": {"delta_um": [x, y, z], "quat": [x, y, z, w], "grasp_mrad": g}}}
        increments of a console since its last message, ITP frame, as the robot would take them (the console has scaled
        them); applied once. They too are stale after `STALE_MS`.
    {"type": "operator", "do": DO}
        DO: estop, restart, rehearse, reengage, discard, note (with "text")
    {"type": "instructor", "do": DO}
        DO: arm (with "hazard": its number in the session's list), disarm, pause, resume, reset, end, cue (with "on")

Events that a session tells have "tick" (ms since the session began, pauses left out) and "kind":

    phase (phase), view (view), console (alive, source), pedal (down), runlevel (runlevel), alarm (check),
    hazard_armed (number), hazard_struck (number), knowable (number, by), cue (number or -1, arm),
    stray (number, arm, mm), response (number, what, ok, ms), hazard_over (number, outcome, score), target (target),
    object (held, at), task_done, note (text), overrun (late_ticks), trouble (text),
    end (reason)

`number` counts the hazards of the session's list (`session.json`, "hazards").
"""

from __future__ import annotations

STALE_MS = 250
"""Input that is older counts as none: pedal up, hands at rest, no force."""
VIEW = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
"""Axes of the operator's view in the world (z up, gold arm at negative x): right, up, toward the operator."""
OPERATOR = ("estop", "restart", "rehearse", "reengage", "discard", "note")
INSTRUCTOR = ("arm", "disarm", "pause", "resume", "reset", "end", "cue")

"""The words of a fault: effects and triggers, each with its meaning. Knows nothing of any robot.

A fault is: at one channel of one site, while its window is open, apply one effect with one value. The window opens
`start` after the trigger's clock begins, lasts `duration`, and with `every` > 0 opens again after each `every`.
"""

from __future__ import annotations

EFFECTS: dict[str, str] = {
    "overwrite": "x becomes the value",
    "offset": "x plus the value",
    "latch_offset": "the first number of the window plus the value, held for the whole window",
    "scale": "x times the value",
    "drift": "x plus the value times the ticks in the window",
    "stuck": "x as it was in the last tick before the window",
    "bit_flip": "the bit of that index (0 = lowest; of the int32 or float32 pattern) inverted",
    "periodic": "x plus value sin(2 pi n / period), n the ticks in the window",
    "random": "uniform in [-value, value], anew each tick",
    "toggle": "the value in even ticks of the window, 0 in odd ones",
    "drop": "network: the packet does not arrive",
    "duplicate": "network: the packet before arrives once more in its place",
    "delay": "network: packets arrive this many packets late",
}
EFFECT_CODES: dict[str, int] = {name: i for i, name in enumerate(EFFECTS)}

NETWORK_EFFECTS: dict[str, tuple[str, str, float | None]] = {
    "drop": ("lost", "overwrite", 1.0),
    "duplicate": ("lag", "overwrite", 1.0),
    "delay": ("delay", "overwrite", None),
}
"""What the effects of the network stand for: (channel of site network, effect, value or None for the fault's own)."""

TRIGGERS: dict[str, str] = {
    "time": "milliseconds since the run began",
    "packet": "sequence numbers of the console's packets",
    "pedal": "milliseconds since the first cycle after pedal-down was entered; closed while it is not in it",
}
TRIGGER_CODES: dict[str, int] = {name: i for i, name in enumerate(TRIGGERS)}

MAX_SLOTS = 8
"""Faults that one run may hold."""

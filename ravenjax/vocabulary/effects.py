"""What a fault does to a number, and when it acts; for any robot.

A fault acts on one channel of one site. While its window is open, it applies one effect with one
value. The window opens `start` after the trigger's clock begins and lasts `duration`. With `every`
> 0 it opens again after each `every`.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

FIELDS = (
    "site",
    "arm",
    "channel",
    "effect",
    "value",
    "trigger",
    "start_ms",
    "duration_ms",
    "every_ms",
    "period_ms",
)
"""Columns of a slot in order. In the table they are prefixed with fault0_, fault1_, ..."""

Value = Literal["number", "change", "amount", "factor", "bit", "packets", "probability", ""]
"""What the value of an effect is.

It is a number as the channel stores it; a change of such a number; an amount in the channel's unit,
whole or not; a factor; the index of a bit; a number of packets; or a probability. "": the effect
takes no value.
"""


class OfNetwork(NamedTuple):
    """The channel, effect and value at site network that an effect of the network abbreviates."""

    channel: str
    effect: str
    value: float | None  # None: the value of the fault itself


class Effect(NamedTuple):
    """One fault effect."""

    name: str
    meaning: str  # x: the number on which the fault acts
    value: Value
    network: OfNetwork | None = None  # only for effects at site network

    @property
    def takes_value(self) -> bool:
        """Whether a fault with this effect has a value."""
        return self.value != ""

    @property
    def of_its_type(self) -> bool:
        """Whether its value is a number of the channel's own type."""
        return self.value in ("number", "change")

    @property
    def in_its_unit(self) -> bool:
        """Whether its value has the channel's unit."""
        return self.value in ("number", "change", "amount")


_ALL = (
    Effect("overwrite", "x becomes the value", "number"),
    Effect("offset", "x plus the value", "change"),
    Effect(
        "latch_offset",
        "the first number of the window plus the value, held for the whole window",
        "change",
    ),
    Effect("scale", "x times the value", "factor"),
    Effect("drift", "x plus the value times the ticks in the window", "amount"),
    Effect("stuck", "x as it was in the last tick before the window", ""),
    Effect(
        "bit_flip",
        "the bit of that index (0 = lowest; of the int32 or float32 pattern) inverted",
        "bit",
    ),
    Effect("periodic", "x plus value sin(2 pi n / period), n the ticks in the window", "amount"),
    Effect("random", "a number drawn in each tick, uniformly from -value to value", "amount"),
    Effect("toggle", "the value in even ticks of the window, 0 in odd ones", "number"),
    Effect("drop", "network: the packet does not arrive", "", OfNetwork("lost", "overwrite", 1.0)),
    Effect(
        "duplicate",
        "network: the packet before arrives once more in its place",
        "",
        OfNetwork("lag", "overwrite", 1.0),
    ),
    Effect(
        "delay",
        "network: packets arrive this many packets late",
        "packets",
        OfNetwork("delay", "overwrite", None),
    ),
    Effect(
        "lose",
        "network: in each ms, with this probability, a loss of all packets of period_ms ms begins",
        "probability",
        OfNetwork("lost", "lose", None),
    ),
)

EFFECTS: dict[str, Effect] = {effect.name: effect for effect in _ALL}
EFFECT_CODES: dict[str, int] = {name: i for i, name in enumerate(EFFECTS)}

NETWORK_EFFECTS: dict[str, OfNetwork] = {
    effect.name: effect.network for effect in _ALL if effect.network
}
"""What each effect of the network abbreviates."""

WITHOUT_VALUE = tuple(effect.name for effect in _ALL if not effect.takes_value)

WITH_PERIOD = ("periodic", "lose")
"""Effects that read the period of a fault."""
RANDOM = ("random", "lose")
"""Effects that draw numbers in each tick."""

TRIGGERS: dict[str, str] = {
    "time": "milliseconds since the run began",
    "packet": "sequence numbers of the console's packets",
    "pedal": (
        "milliseconds since the first cycle after pedal-down was entered; closed while it is not"
        " in it"
    ),
}
TRIGGER_CODES: dict[str, int] = {name: i for i, name in enumerate(TRIGGERS)}

MAX_SLOTS = 8
"""Largest number of faults that one run may have."""

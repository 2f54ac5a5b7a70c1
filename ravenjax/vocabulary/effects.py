"""Defines for any robot what a fault does to a number, and when the fault acts.

A fault acts on one channel of one site. While its window is open, it applies one effect with one
value. The window opens when the trigger's clock reaches `start`, and lasts `duration`. If `every`
is above 0, the window opens again after each `every`.
"""

from typing import Literal, NamedTuple

from ravenjax import resources

TIMES = ("start_ms", "duration_ms", "every_ms", "period_ms")
FIELDS = ("site", "arm", "channel", "effect", "value", "trigger", *TIMES)
"""Columns of a fault slot, in order. In the table they have the prefix fault0_, fault1_, ..."""

Value = Literal["number", "change", "amount", "factor", "bit", "packets", "probability", ""]
"""Kinds of values of effects.

A `number` replaces the channel's number, and a `change` is added to it; both have the channel's
type. An `amount` has the channel's unit, but may be a fraction. A `bit` is the index of a bit. "":
the effect has no value.
"""


class OfNetwork(NamedTuple):
    """The plain effect on a channel of site network that a network effect stands for."""

    channel: str
    effect: str
    value: float | None = None  # None: the value of the fault itself


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
        """Whether the value has the channel's number type."""
        return self.value in ("number", "change")

    @property
    def in_its_unit(self) -> bool:
        """Whether the value has the channel's unit."""
        return self.value in ("number", "change", "amount")


EFFECTS: dict[str, Effect] = {
    name: Effect(
        name=name,
        meaning=table["meaning"],
        value=table.get("value", ""),
        network=OfNetwork(*table["network"]) if "network" in table else None,
    )
    for name, table in resources.read_tables(__file__, "effects.toml").items()
}
EFFECT_CODES: dict[str, int] = {name: i for i, name in enumerate(EFFECTS)}

NETWORK_EFFECTS: dict[str, OfNetwork] = {
    effect.name: effect.network for effect in EFFECTS.values() if effect.network
}
"""The plain effect that each network effect stands for."""

WITHOUT_VALUE = tuple(name for name, effect in EFFECTS.items() if not effect.takes_value)

WITH_PERIOD = ("periodic", "lose")
"""Effects that use the period of a fault."""
RANDOM = ("random", "lose")
"""Effects that draw random numbers in each tick."""

TRIGGERS: dict[str, str] = {
    "time": "milliseconds since the run began",
    "packet": "sequence numbers of the console's packets",
    "pedal": "milliseconds since pedal-down began; outside of pedal-down the fault does not act",
}
TRIGGER_CODES: dict[str, int] = {name: i for i, name in enumerate(TRIGGERS)}

MAX_SLOTS = 8
"""Largest number of faults that one run may have."""

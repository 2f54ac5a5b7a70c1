"""Makes the runs of a search from the one group of its file.

The lists of the group define *cases*: each case is one combination of their values (designs "grid"
and "zip"). An *input* is a number of a fault, or a parameter, that has a distribution in the file.
A *point* is a case with a value for each input. Each point is one run of an ordinary campaign.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ravenjax import resources
from ravenjax.analyses.search.file.config import Search
from ravenjax.campaign.faults import design, sampling
from ravenjax.campaign.faults.moments import Moments
from ravenjax.campaign.faults.sampling import Key
from ravenjax.campaign.faults.table import WORDS
from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.location import Complaint
from ravenjax.vocabulary.effects import NETWORK_EFFECTS, WITHOUT_VALUE
from ravenjax.vocabulary.legal import legal_values
from ravenjax.vocabulary.sites import Channel

PARAMETER = -1
"""Replaces the number of the fault slot in the key of a parameter."""


def template_axes(config: CampaignConfig) -> dict[Key, Axis]:
    """Return the values or distribution of every key of the template, including defaults. Keys of
    faults come first, slot by slot, then parameters.
    """
    _, axes = next(design.faults_and_axes(config, config.group[0]))
    return axes


def axis_name(key: Key) -> str:
    """Return the name of a key: its column in the result table, or the path of a parameter."""
    slot, name = key
    return name if slot == PARAMETER else f"fault{slot}_{name}"


def find_search_errors(config: CampaignConfig, search: Search | None) -> list[Complaint]:
    """Return (key, message) of mistakes that only a search file can have."""
    # Path in the file, name and distribution of each key that has a distribution.
    drawn = {"words": [], "numbers": []}
    for (slot, name), axis in template_axes(config).items():
        if not axis.drawn:
            continue
        if slot != PARAMETER:
            table = f"group/0/fault/{slot}"
        elif name in config.group[0].parameters:
            table = "group/0/parameters"
        else:
            table = "parameters"
        kind = "words" if slot != PARAMETER and name in WORDS else "numbers"
        drawn[kind].append((f"{table}/{name}", axis_name((slot, name)), axis))
    # The template contains the rules, and returns (path in the file, message) of each mistake.
    template = Path(__file__).with_name("search_errors.j2")
    rows = resources.render_rows(template, config=config, search=search, **drawn)
    return [
        (tuple(int(part) if part.isdigit() else part for part in key.split("/")), message)
        for key, message in rows
    ]


class Template:
    """Converts points of a search to runs."""

    def __init__(self, config: CampaignConfig):
        """Prepare the cases and inputs of a `config` without `find_search_errors`."""
        self.config = config
        self._axes = Moments(config).convert_phases(template_axes(config), config.group[0].name)
        undrawn = {key: axis for key, axis in self._axes.items() if not axis.drawn}
        # The remaining keys have no distribution, so the random generator is not used.
        sample = sampling.sample_runs(config.group[0], undrawn, np.random.default_rng(0))
        self.cases = sample.runs
        self.inputs = tuple(key for key, axis in self._axes.items() if axis.drawn)
        self.lists = tuple(
            key for key, axis in undrawn.items() if axis.kind == "list" and len(axis.values) > 1
        )
        # For each key, its value in each case.
        self._values = {
            key: [axis.values[index] for index in np.broadcast_to(sample.places[key], sample.runs)]
            for key, axis in undrawn.items()
        }
        # Whether an input has only whole numbers, [cases, inputs].
        self.whole = np.array(
            [[self._is_whole(key, case) for key in self.inputs] for case in range(self.cases)], bool
        )

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of the inputs."""
        return tuple(map(axis_name, self.inputs))

    def axis(self, number: int) -> Axis:
        """Return the distribution of an input."""
        return self._axes[self.inputs[number]]

    def describe_inputs(self) -> list[dict[str, Any]]:
        """Return name, unit and distribution of each input, as JSON values."""
        return [
            {"name": name, "unit": self.unit(i), "drawn": self.axis(i).written()}
            for i, name in enumerate(self.labels)
        ]

    def case(self, case: int) -> dict[str, Any]:
        """Return the value of each list in a case, by the name of the key."""
        return {axis_name(key): self._values[key][case] for key in self.lists}

    def unit(self, number: int) -> str:
        """Return the unit of an input: the unit of the channel for the value of a fault, ms for a
        time; "" for a parameter, or if cases have different units.
        """
        slot, name = self.inputs[number]
        if slot == PARAMETER:
            return ""
        if name != "value":
            return "ms"
        channels = [self._target(slot, case)[0] for case in range(self.cases)]
        units = {channel.unit for channel in channels if channel}
        return units.pop() if len(units) == 1 else ""

    def values(self, case: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """Return the values of the inputs, float64 [n, inputs], at points of the unit cube `unit`
        [n, inputs]. case: the case of each point [n].

        A coordinate is a quantile of the input's distribution, as in a sampled design.
        """
        is_whole, values = self.whole[case], np.empty(unit.shape)
        for i, (slot, name) in enumerate(self.inputs):
            axis = self.axis(i)
            places = axis.places(unit[:, i])
            is_time = slot != PARAMETER and name != "value"
            # Whole values are multiples of `step`: times in ms are whole ticks of the robot.
            step = self.config.robot.period_ms if is_time else 1
            values[:, i] = np.where(is_whole[:, i], axis.at(places, whole=step), axis.at(places))
            # A drawn duration or period is at least one tick, another drawn time at least 0.
            if is_time and not axis.listed:
                smallest = step if name in ("duration_ms", "period_ms") else 0
                values[:, i] = np.maximum(values[:, i], smallest)
        return values

    def campaign(self, case: np.ndarray, values: np.ndarray) -> CampaignConfig:
        """Return the campaign whose runs are these points: case [n], values [n, inputs]."""
        group = self.config.group[0]
        # Each key (slot, field) or (PARAMETER, path) that differs gets a list of values, one per
        # point. The design "zip" makes a run of each point. `_values`: value of a key in each case.
        columns = {key: [self._values[key][c] for c in case.tolist()] for key in self.lists}
        columns |= {key: values[:, i].tolist() for i, key in enumerate(self.inputs)}
        axes = {key: Axis("list", tuple(column)) for key, column in columns.items()}
        faults = []
        for number, fault in enumerate(group.fault):
            fault_axes = {name: axis for (slot, name), axis in axes.items() if slot == number}
            faults.append(fault.model_copy(update=fault_axes))
        all_axes = (self._axes | axes).items()
        parameters = {path: axis for (slot, path), axis in all_axes if slot == PARAMETER}
        update = {"design": "zip", "fault": tuple(faults), "parameters": parameters}
        group = group.model_copy(update=update)
        return self.config.model_copy(update={"group": (group,), "parameters": {}})

    def _is_whole(self, key: Key, case: int) -> bool:
        # True if the campaign rounds the input: times, and values of channels with whole numbers.
        slot, name = key
        if slot == PARAMETER:
            return False
        if name != "value":
            return True
        channel, effect = self._target(slot, case)
        return (
            channel is not None
            and effect not in WITHOUT_VALUE
            and legal_values(channel, effect).rounded
        )

    def _target(self, slot: int, case: int) -> tuple[Channel | None, str]:
        # Returns the channel on which a fault acts in one case, and its effect.
        site = self.config.robot.sites[self.config.group[0].fault[slot].site]
        effect = str(self._values[slot, "effect"][case])
        # The effect determines the channel of a network effect.
        if effect in NETWORK_EFFECTS:
            name = NETWORK_EFFECTS[effect][0]
        else:
            name = self._values[slot, "channel"][case]
        return next((channel for channel in site.channels if channel.name == name), None), effect

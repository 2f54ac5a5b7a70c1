"""Converts fault onsets in a phase of the operation into milliseconds."""

import dataclasses
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from ravenjax.campaign.faults.sampling import Key
from ravenjax.campaign.file.axis import PHASE, Axis, Moment
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError


class Moments:
    """The phases of a campaign's operation. They are computed when the first onset needs them."""

    def __init__(self, config: CampaignConfig) -> None:
        self._config = config

    @cached_property
    def phases(self) -> Mapping[str, np.ndarray]:
        """{phase: int [stretches, 2]}, each from its first tick to before its end."""
        return self._config.robot.part("campaign").phases(self._config)

    def placed(self, axes: Mapping[Key, Axis], group: str) -> dict[Key, Axis]:
        """Return a group's axes with all onsets in milliseconds.

        Raises UserError for a phase that never occurs.
        """
        return {
            key: self._axis(axis, f"group {group!r}, fault[{key[0]}].{key[1]}")
            for key, axis in axes.items()
        }

    def _axis(self, axis: Axis, where: str) -> Axis:
        if axis.kind == PHASE:
            stretches = self._stretches(axis.values[0], where)
            return Axis(PHASE, (axis.values[0], *map(tuple, stretches.tolist())))
        if not axis.phases:
            return axis
        values = tuple(self._value(value, where) for value in axis.values)
        return dataclasses.replace(axis, values=values)

    def _value(self, value: Any, where: str) -> Any:
        if not isinstance(value, Moment):
            return value
        stretches = self._stretches(value.phase, where)
        after = np.cumsum(stretches[:, 1] - stretches[:, 0])
        place = round(value.share * (int(after[-1]) - 1))
        number = int(np.searchsorted(after, place, side="right"))
        return int(stretches[number, 1] + place - after[number])

    def _stretches(self, phase: str, where: str) -> np.ndarray:
        stretches = self.phases[phase]
        if not len(stretches):
            there = ", ".join(name for name, some in self.phases.items() if len(some))
            raise UserError(
                f"{where}: phase {phase!r} ({self._config.robot.phases[phase]}) never comes in the"
                f" {self._config.campaign.ticks} ms of this operation; expected one that does:"
                f" {there}. Write that, or take another motion, a longer campaign.duration_s or"
                " another scale"
            )
        return stretches


def used_phases(config: CampaignConfig) -> Iterator[str]:
    """Yield each phase that onsets of a campaign name, once."""
    faults = [fault for group in config.group for fault in group.fault]
    faults += [
        fault for group in config.group for run in group.run for fault in group.faults_of(run)
    ]
    yield from dict.fromkeys(phase for fault in faults for phase in fault.start_ms.phases)

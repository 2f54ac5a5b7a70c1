"""Converts the start of a fault, given as a phase of the operation, into milliseconds."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from ravenjax.campaign.faults.sampling import Key
from ravenjax.campaign.file.axis import PHASE, Axis, Moment
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError


@dataclasses.dataclass(eq=False)
class Moments:
    """Converts fault starts that name a phase. The phases are computed at the first use."""

    config: CampaignConfig

    @cached_property
    def phases(self) -> Mapping[str, np.ndarray]:
        """{phase: int [stretches, 2]}: first tick of each stretch, and first tick after it."""
        return self.config.robot.part("campaign").phases(self.config)

    def placed(self, axes: Mapping[Key, Axis], group: str) -> dict[Key, Axis]:
        """Return a group's axes with all fault starts in milliseconds.

        Raise UserError for a phase that never occurs.
        """
        return {
            key: self._axis(axis, f"group {group!r}, fault[{key[0]}].{key[1]}")
            for key, axis in axes.items()
        }

    def _axis(self, axis: Axis, where: str) -> Axis:
        # Replaces phases in the values of an axis by milliseconds of this operation.
        if axis.kind == PHASE:
            return self._phase(axis.values[0], where)
        values = (self._ms(v, where) if isinstance(v, Moment) else v for v in axis.values)
        return dataclasses.replace(axis, values=tuple(values))

    def _ms(self, moment: Moment, where: str) -> int:
        phase = self._phase(moment.phase, where)
        count = sum(end - begin for begin, end in phase.values[1:])
        return int(phase.at(np.array((round(moment.share * (count - 1)) + 0.5) / count)))

    def _phase(self, phase: str, where: str) -> Axis:
        # Returns an axis over all moments of a phase. where: location for error messages.
        stretches = self.phases[phase]
        if not len(stretches):
            there = ", ".join(name for name, some in self.phases.items() if len(some))
            raise UserError(
                f"{where}: phase {phase!r} ({self.config.robot.phases[phase]}) does not occur in"
                f" the {self.config.campaign.ticks} ms of this operation; expected one of {there}."
                " Write such a phase, or another motion, a longer campaign.duration_s or another"
                " scale"
            )
        return Axis(PHASE, (phase, *map(tuple, stretches.tolist())))

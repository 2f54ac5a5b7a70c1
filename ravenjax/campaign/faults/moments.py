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

    def convert_phases(self, axes: Mapping[Key, Axis], group: str) -> dict[Key, Axis]:
        """Return axes with fault starts in ms. Raise UserError for a phase that never occurs."""
        # The key of an axis with a phase is (fault slot, "start_ms").
        return {
            key: self._convert_axis(axis, f"group {group!r}, fault[{key[0]}].{key[1]}")
            for key, axis in axes.items()
        }

    def _convert_axis(self, axis: Axis, where: str) -> Axis:
        # Replaces phases in the values of an axis by milliseconds of this operation.
        if axis.kind == PHASE:
            return self._phase_axis(axis.values[0], where)
        values = (self._find_ms(v, where) if isinstance(v, Moment) else v for v in axis.values)
        return dataclasses.replace(axis, values=tuple(values))

    def _find_ms(self, moment: Moment, where: str) -> int:
        # Returns the millisecond at a share of a phase: 0 is its first millisecond, 1 its last.
        axis = self._phase_axis(moment.phase, where)
        _, *stretches = axis.values
        count = sum(end - begin for begin, end in stretches)
        number = round(moment.share * (count - 1))
        # `Axis.at` divides [0, 1) into a part for each millisecond. The middle is safe to round.
        return int(axis.at(np.array((number + 0.5) / count)))

    def _phase_axis(self, phase: str, where: str) -> Axis:
        # Returns an axis over all milliseconds of a phase, with the values phase, (begin, end), ..
        # where: location for error messages.
        stretches = self.phases[phase]
        if not len(stretches):
            occurring = ", ".join(name for name, ticks in self.phases.items() if len(ticks))
            raise UserError(
                f"{where}: phase {phase!r} ({self.config.robot.phases[phase]}) does not occur in"
                f" the {self.config.campaign.ticks} ms of this operation; expected one of"
                f" {occurring}. Write such a phase, or another motion, a longer campaign.duration_s"
                " or another scale"
            )
        return Axis(PHASE, (phase, *map(tuple, stretches.tolist())))

"""How long each part may measure, so that the whole stays below the time that was asked for.

A part costs what it costs on two quiet cores times how much slower this machine has proved with the
parts before it; what is left beyond that is shared by weight. A part that no longer fits is left
out and says so: the most telling come first.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

FULL_S, QUICK_S = 160.0, 35.0
"""s, of the whole benchmark where nothing else is asked for: the rest to three minutes is for
the last part's error.
"""
LEAST_S, LONGEST_S = 5.0, 86_400.0
"""s that may be asked for."""
# s, how much the belief weighs that this machine is as fast as the one that costs are from
_PRIOR_S = 10.0
_SLOWEST, _FASTEST = 20.0, 0.2  # that a machine may prove: one odd part says no more


@dataclasses.dataclass(frozen=True)
class PartCost:
    """What a part takes."""

    # s on two quiet cores without what it measures: processes, imports, tracing, compiling
    usual_s: float
    least_s: float  # s that it must measure, below which it says nothing
    most_s: float  # s, beyond which more says no more

    @property
    def weight(self) -> float:
        """Its part of the time that is left."""
        return self.most_s - self.least_s


@dataclasses.dataclass
class Allotment:
    """Shares out the time of one benchmark."""

    total_s: float
    _spent_s: float = 0.0
    _usual_s: float = _PRIOR_S  # of parts that are done, with the prior
    _actual_s: float = _PRIOR_S

    @property
    def slowness(self) -> float:
        """Times that parts took what they usually take."""
        return min(_SLOWEST, max(_FASTEST, self._actual_s / self._usual_s))

    @property
    def left_s(self) -> float:
        """s, of the whole."""
        return self.total_s - self._spent_s

    def needs(self, cost: PartCost) -> float:
        """s that a part takes at least."""
        return cost.usual_s * self.slowness + cost.least_s

    def share(self, cost: PartCost, later: Sequence[PartCost]) -> float | None:
        """s that the next part may measure, with these after it; None: it no longer fits."""
        spare = self.left_s - self.needs(cost)
        if spare < 0.0:
            return None
        spare -= sum(map(self.needs, later))
        weights = cost.weight + sum(one.weight for one in later)
        return cost.least_s + max(
            0.0, min(cost.weight, spare * cost.weight / weights if weights else 0.0)
        )

    def done(self, cost: PartCost, measuring_s: float, seconds: float) -> None:
        """A part took `seconds`, of which it was to measure `measuring_s`."""
        self._spent_s += seconds
        self._usual_s += cost.usual_s
        self._actual_s += max(0.0, seconds - measuring_s)

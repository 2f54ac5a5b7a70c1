"""Of which alarms it is a finding that they come before the motion, and of which the definitions
decide it.

Cue and tip-error detector fire at a distance of the reported tip from the nominal model; an
unintended motion begins where the true tip is farther than the limit from that model, and from
more. So an alarm at the limit is there when the motion is, by these definitions alone, unless the
robot's report is wrong or late, and one beyond needs more than the motion does. Neither is a
warning of it.
"""

from __future__ import annotations

from ravenjax.store.manifest import DetectorRecord, Manifest

TIP_ERROR = "tip_error"
"""Kind of the detector that measures this distance, mm."""


def cue(manifest: Manifest, number: int) -> bool:
    """Whether the lead of a haptic set is a finding."""
    return manifest.cues[number].threshold_mm < manifest.limit_mm


def detector(manifest: Manifest, one: DetectorRecord, threshold: float) -> bool:
    """Whether the lead of a detector at a threshold is one."""
    return one.kind != TIP_ERROR or threshold < manifest.limit_mm

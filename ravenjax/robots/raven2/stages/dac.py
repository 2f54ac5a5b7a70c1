"""Converts torques to DAC counts: float32, truncated toward zero, saturated to 16 bits.

raven2: t_to_DAC_val.cpp, utils.cpp.
"""

from ravenjax.numbers import Scalar, Vec, clamp, jnp, to_int32
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.setup import ArmName, RavenSetup

HIGHEST, LOWEST = 32767, -32768


def step(
    setup: RavenSetup, arm: ArmName, tool: str, tau_d: Vec, otherwise: Vec, enabled: Scalar
) -> Vec:
    """Return DAC counts (7 int32) of capstan torques (N m) if `enabled`, else `otherwise`."""
    amps_per_torque = stored.amps_per_torque(arm, tool, setup.software)

    def to_counts(tau: Scalar, per_torque: float, per_amp: float, rest: Scalar) -> Scalar:
        return _saturate_or_replace(to_int32(tau * per_torque * per_amp), enabled, rest)

    return tau_d.map(to_counts, amps_per_torque, transmission.COUNTS_PER_AMP, otherwise)


def stored_counts(counts: Vec, enabled: Scalar, otherwise: Vec) -> Vec:
    """Return counts (7 int32) saturated to 16 bits if `enabled`, else `otherwise`."""
    return counts.map(lambda count, rest: _saturate_or_replace(count, enabled, rest), otherwise)


def _saturate_or_replace(count: Scalar, enabled: Scalar, otherwise: Scalar) -> Scalar:
    return jnp.where(enabled, clamp(count, LOWEST, HIGHEST), otherwise)

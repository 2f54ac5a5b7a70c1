"""The tick of a campaign as pure functions of one run, for `jit`, `vmap`, `grad` and `shard_map`.

    from ravenjax import functional

    model = functional.load("campaign.toml", vary=["nominal.gold.kp.shoulder"])
    golden = model.rollout(params, no_faults)
    run = model.rollout(params, faults, golden.series)

Parameters are a dict of path -> number, faults a record of numbers. Both are pytrees.
`Model.params` and `Model.faults` hold those of all runs of the campaign, each leaf [runs], so
`jax.vmap` computes the campaign. Parts of a Raven-II also work alone: `nominal` (`init`, `step`,
`track_target`), `control` (`init`, `control_cycle`) and `inject`. They take `Model.setup` and the
parts of `Model.record`.

Encoder counts and DAC commands are whole numbers, whose derivative is 0 in JAX. So a derivative is
exact for the nominal model and for what follows the DAC within a tick. It does not pass through the
control software.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.loading import load_campaign
from ravenjax.campaign.plan import make_plan
from ravenjax.engines.interface import TickProgram
from ravenjax.faults import injection
from ravenjax.faults.fault import Faults, FaultState, TriggerClocks, open_windows
from ravenjax.numbers import paths
from ravenjax.numbers.setup import CAMPAIGN, Precision
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.loop.injector import RavenInjector
from ravenjax.robots.raven2.plant import nominal

__all__ = ["Model", "Rollout", "control", "inject", "load", "nominal"]


class Rollout(NamedTuple):
    """A run, or its first ticks."""

    outcomes: dict[str, Any]  # columns of the result table before the verdict
    # Numbers with which runs that have this golden run are compared, [ticks, numbers]. For each arm
    # of a Raven-II: true tip (m), then measured tip (um).
    series: Any
    signals: Any  # record of every signal, each leaf [ticks]


@dataclasses.dataclass(frozen=True, eq=False)
class Model:
    """Robot, software, operator and haptics of a campaign. No method changes it."""

    program: TickProgram
    motion: tuple[Any, ...]  # columns of the operator's motion, each [ticks]
    params: dict[str, Any]  # path -> [runs], parameters that vary; units as `ravenjax parameters`
    faults: Faults  # each leaf [runs]

    @property
    def setup(self) -> Any:
        """Static choices that select the code of the tick."""
        return self.program.setup

    @property
    def targets(self) -> dict[injection.ChannelKey, int]:
        """The code in `FaultSlot.code` of each (site, arm, channel) on which the campaign has
        faults; code 0 means no fault.
        """
        return {key: i + 1 for i, key in enumerate(injection.channel_keys(self.setup))}

    def record(self, params: Mapping[str, Any]) -> Any:
        """Return every parameter of the robot, those in `params` at these values.

        Raises KeyError for an unknown path, as all methods do.
        """
        return self._with(params).params_of(list(params.values()))

    def init(self, params: Mapping[str, Any]) -> Any:
        """Return the state before the first tick."""
        return self._with(params).begin(list(params.values()))

    def step(
        self, params: Mapping[str, Any], faults: Faults, state: Any, tick: Any, golden: Any
    ) -> tuple[Any, tuple[Any, ...], Any]:
        """Compute one tick, 1 ms; return the new state, the run's series in this tick, and every
        signal.

        tick: int32, from 0. golden: `Rollout.series` of the golden run in this tick, [numbers].
        """
        values = list(params.values())
        return self._with(params).step(values, faults, (), state, tick, golden, self.motion)

    def rollout(
        self,
        params: Mapping[str, Any],
        faults: Faults,
        golden: Any = None,
        ticks: int | None = None,
    ) -> Rollout:
        """Compute a run from its beginning.

        golden: `Rollout.series` of its golden run; None: it is a golden run. ticks: static, ms;
        None: as long as `golden`, or the campaign's runs.
        """
        if golden is None:
            length = self.program.loop.series_length(self.setup)
            ticks = ticks or self.program.ticks
            golden = jnp.zeros((ticks, length), self.setup.precision.real)

        def advance(state: Any, x: tuple[Any, Any]) -> tuple[Any, tuple[Any, Any]]:
            state, series, signals = self.step(params, faults, state, *x)
            return state, (jnp.stack(series), signals)

        golden = golden[:ticks]
        moments = jnp.arange(len(golden), dtype=jnp.int32)
        state, (series, signals) = jax.lax.scan(advance, self.init(params), (moments, golden))
        outcomes = self._with(params).finish(list(params.values()), state)
        return Rollout(outcomes, series, signals)

    def _with(self, params: Mapping[str, Any]) -> TickProgram:
        return dataclasses.replace(self.program, varied=tuple(params), ends=False)


def load(
    campaign: CampaignConfig | str | Path | dict[str, Any],
    vary: Sequence[str] = (),
    precision: Precision = CAMPAIGN,
) -> Model:
    """Return the functions and inputs of a campaign.

    vary: paths of further parameters for `Model.params`, at the campaign's values. precision: for
    float64, set `jax_enable_x64` too. Raises UserError for a campaign that cannot be run.
    """
    config = campaign if isinstance(campaign, CampaignConfig) else load_campaign(campaign)
    plan = make_plan(config, precision)
    varied, faults = plan.lanes(range(plan.runs), plan.runs)
    for path in vary:
        found = paths.named_numbers(plan.program.params, plan.program.setup, path)
        varied = {name: np.full(plan.runs, value) for name, value in found.items()} | varied
    params, faults = jax.tree.map(jnp.asarray, (varied, faults))
    return Model(plan.program, tuple(map(jnp.asarray, plan.columns)), params, faults)


def inject(
    setup: Any, faults: Faults, state: FaultState, tick: Any, site: str, signal: Any
) -> tuple[FaultState, Any]:
    """Apply the faults to the signal of one site of a Raven-II in one tick.

    Returns the faults' new state and the changed signal. state: that of the tick before; in the
    first tick `Model.init(params).faults`. Every trigger's clock starts at tick 0. signal: in the
    form in which `loop.tick` and `loop.control` pass it, for example DAC counts, 7 int32 for each
    arm.
    """
    clocks = TriggerClocks(tick, tick + 1, tick)
    injector = RavenInjector(setup, faults, open_windows(setup, faults, state, clocks), clocks)
    signal = injector(site, signal)
    return injector.state, signal

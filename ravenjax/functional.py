"""Provides a campaign's simulation as pure functions of one run, for `jit`, `vmap` and `grad`.

    from ravenjax import functional

    model = functional.load("campaign.toml", vary=["nominal.gold.kp.shoulder"])
    golden = model.rollout(params, no_faults)
    run = model.rollout(params, faults, golden.series)

Parameters are a dict from path to number, and faults are a record of numbers; both are pytrees.
`Model.params` and `Model.faults` contain the values of all runs of the campaign, with leaves of
shape [runs], so that `jax.vmap` computes the campaign. You can also call a part of a robot alone,
such as the nominal model of the Raven-II (docs/tutorials/jax.md). Give the part `Model.setup` and
the field of `Model.record(params)` with its parameters, or of `stages` for an optional stage.

For the Raven-II, the derivatives of the nominal model are exact over any number of ticks. Those of
everything after the DAC are exact only over one tick. Derivatives through the control software are
0, because encoder counts and DAC commands are integers.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.loading import load_campaign
from ravenjax.campaign.plan import make_plan
from ravenjax.engines.interface import Block, BlockResult, TickProgram
from ravenjax.engines.selection import select_engine
from ravenjax.faults import injection
from ravenjax.faults.fault import Faults, FaultState, TriggerClocks, open_windows
from ravenjax.numbers import paths
from ravenjax.numbers.setup import CAMPAIGN, Precision
from ravenjax.threads import map_in_threads

LANES = 1 << 20
"""Number of runs for which `Model.run_compiled` chooses the size of its blocks."""

__all__ = ["Model", "Rollout", "load"]


class Rollout(NamedTuple):
    """Outcomes, series and signals that `Model.rollout` returns, for the ticks it computed."""

    outcomes: dict[str, Any]  # columns of the result table before the verdict
    # [ticks, numbers], with which faulty runs are compared if this run is their golden run. For
    # each arm of a Raven-II: true tip (m), then measured tip (um).
    series: Any
    signals: Any  # record of every signal, each leaf [ticks]


@dataclasses.dataclass(frozen=True, eq=False)
class Model:
    """The model of a campaign: robot, software, operator and haptics. It is immutable."""

    program: TickProgram
    motion: tuple[Any, ...]  # columns of the operator's motion, each [ticks]
    params: dict[str, Any]  # path -> [runs], parameters that vary; units: `ravenjax parameters`
    faults: Faults  # each leaf [runs]

    @property
    def setup(self) -> Any:
        """Settings that select the code of the tick."""
        return self.program.setup

    @property
    def targets(self) -> dict[injection.ChannelKey, int]:
        """The value of `FaultSlot.code` for a fault at each (site, arm, channel); 0: no fault."""
        return {key: i + 1 for i, key in enumerate(self.setup.injection.channels)}

    def record(self, params: Mapping[str, Any]) -> Any:
        """Return all parameters of the robot. Values in `params` replace the robot's values.

        All methods raise KeyError for an unknown path.
        """
        return self._with(params).params_of(list(params.values()))

    def init(self, params: Mapping[str, Any]) -> Any:
        """Return the state before the first tick."""
        return self._with(params).begin(list(params.values()))

    def step(
        self, params: Mapping[str, Any], faults: Faults, state: Any, tick: Any, golden: Any
    ) -> tuple[Any, tuple[Any, ...], Any]:
        """Compute one tick. Return the new state, one row of `Rollout.series`, and all signals.

        tick: int32, from 0. golden: the row of this tick in the golden run's `Rollout.series`.
        """
        values = list(params.values())
        # (): the run does not end early.
        return self._with(params).step(values, faults, (), state, tick, golden, self.motion)

    def inject(
        self, faults: Faults, state: FaultState, tick: Any, site: str, signal: Any
    ) -> tuple[FaultState, Any]:
        """Apply the faults of one site of the robot in one tick.

        Return the new state of the faults and the changed signal. state: before the first tick, it
        is `Model.init(params).faults`. signal: the site's value in this tick, for example DAC
        counts, 7 int32 for each arm of a Raven-II. Triggers count ms or packets from tick 0.
        """
        # In each tick a packet arrives, the first with number 1, and the pedal is always down.
        clocks = TriggerClocks(tick, tick + 1, tick)
        opened = open_windows(self.setup, faults, state, clocks)
        injector = self.program.loop.make_injector(self.setup, faults, opened, clocks)
        signal = injector(site, signal)
        return injector.state, signal

    def rollout(
        self,
        params: Mapping[str, Any],
        faults: Faults,
        golden: Any = None,
        ticks: int | None = None,
    ) -> Rollout:
        """Compute a run from its beginning.

        golden: `Rollout.series` of the golden run; None: the run is itself a golden run. ticks:
        number of milliseconds (static); None: the length of `golden`, or of the campaign's runs.
        """
        if golden is None:
            length = self.program.loop.series_length(self.setup)
            ticks = ticks or self.program.ticks
            golden = jnp.zeros((ticks, length), self.setup.precision.real)

        def advance(state: Any, tick_and_golden: tuple[Any, Any]) -> tuple[Any, tuple[Any, Any]]:
            state, series, signals = self.step(params, faults, state, *tick_and_golden)
            return state, (jnp.stack(series), signals)

        golden = golden[:ticks]
        tick_numbers = jnp.arange(len(golden), dtype=jnp.int32)
        state, (series, signals) = jax.lax.scan(advance, self.init(params), (tick_numbers, golden))
        outcomes = self._with(params).finish(list(params.values()), state)
        return Rollout(outcomes, series, signals)

    def run_compiled(
        self, params: Mapping[str, Any], faults: Faults, golden: Any = None, engine: str = "auto"
    ) -> Rollout:
        """Compute a run on an engine, much faster than `rollout` and bit for bit as in a campaign.

        The method can be called inside `jit` and `vmap`, but has no derivatives. golden: see
        `rollout`; if it is given, `series` of the result is None. `signals` is always None. engine:
        a name that `ravenjax run --engine` accepts.
        """
        program, length = self._with(params), self.program.loop.series_length(self.setup)
        kernel = select_engine(engine, self.setup.precision).compile(program, LANES)
        motion = tuple(map(np.asarray, self.motion))
        shapes = jax.eval_shape(
            lambda values: program.finish(values, program.begin(values)), list(params.values())
        )
        series = jax.ShapeDtypeStruct((program.ticks, length), self.setup.precision.real)
        if golden is not None and golden.shape != series.shape:
            raise ValueError(f"golden has shape {golden.shape}, expected {series.shape}")

        # Each `vmap` adds a leading axis to every array. Its length is 1 if the array is constant.
        def compute(inputs: Any, golden: Any) -> Any:
            # Computes a batch of any shape on the kernel, whose lanes are one-dimensional. inputs:
            # parameters and faults. golden: [*shape, ticks, numbers], or None. Returns the outcomes
            # [*shape], and without `golden` the series of the runs [*shape, ticks, numbers].
            inputs, golden = jax.tree.map(np.asarray, (inputs, golden))
            shape = np.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(inputs)))
            if golden is not None:
                shape = np.broadcast_shapes(shape, golden.shape[:-2])
                # The golden run of each run, as an index in `golden` [ticks, numbers, golden runs].
                golden_index = np.arange(golden[..., 0, 0].size).reshape(golden.shape[:-2])
                golden_index = np.broadcast_to(golden_index, shape).ravel()
                golden = np.moveaxis(golden.reshape(-1, *series.shape), 0, -1)
            inputs = jax.tree.map(lambda leaf: np.broadcast_to(leaf, shape).ravel(), inputs)
            runs = math.prod(shape)

            def run_block(first: int) -> BlockResult:
                # Computes a block of runs from run `first`. Surplus lanes repeat the last run.
                rows = min(kernel.lanes, runs - first)
                run_of_lane = first + np.minimum(np.arange(kernel.size(rows)), rows - 1)
                params, faults = jax.tree.map(lambda leaf: leaf[run_of_lane], inputs)
                golden_of_lane = None if golden is None else golden_index[run_of_lane]
                return kernel.run(Block(params, faults, golden, golden_of_lane, rows=rows), motion)

            parts = map_in_threads(run_block, range(0, runs, kernel.lanes))
            outcomes = {
                name: np.concatenate([part.outcomes[name] for part in parts])[:runs].reshape(shape)
                for name in shapes
            }
            if golden is not None:
                return outcomes, None
            whole = np.concatenate([part.reference for part in parts], axis=-1)[..., :runs]
            return outcomes, np.moveaxis(whole, -1, 0).reshape(*shape, *series.shape)

        found = jax.pure_callback(
            compute,
            (shapes, series if golden is None else None),
            (dict(params), faults),
            golden,
            vmap_method="expand_dims",
        )
        return Rollout(found[0], found[1], None)

    def _with(self, params: Mapping[str, Any]) -> TickProgram:
        return dataclasses.replace(self.program, varied=tuple(params), ends=False)


def load(
    campaign: CampaignConfig | str | Path | dict[str, Any],
    vary: Sequence[str] = (),
    precision: Precision = CAMPAIGN,
) -> Model:
    """Return a campaign's simulation as functions, with the parameters and faults of all its runs.

    vary: paths of parameters to add to `Model.params`, with the campaign's values. precision:
    float64 also requires `jax_enable_x64`. Raise UserError for a campaign that cannot be run.
    """
    config = campaign if isinstance(campaign, CampaignConfig) else load_campaign(campaign)
    plan = make_plan(config, precision)
    varied, faults = plan.lanes(range(plan.runs), plan.runs)
    for path in vary:
        numbers = paths.named_numbers(plan.program.params, plan.program.setup, path)
        # Parameters that the campaign itself varies keep their values: `varied` comes last.
        varied = {name: np.full(plan.runs, value) for name, value in numbers.items()} | varied
    params, faults = jax.tree.map(jnp.asarray, (varied, faults))
    return Model(plan.program, tuple(map(jnp.asarray, plan.columns)), params, faults)

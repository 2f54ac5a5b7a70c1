"""Wraps a vector environment of Gymnasium, to inject faults into its actions and observations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from ravenjax import faults


class FaultyVectorEnv(VectorWrapper):
    """A Gymnasium `VectorEnv` with faults in its actions or observations.

    The faults of each list act one after the other on an array [environments, ...]. Faulty values
    may be outside of the action or observation space. `info["faults"]` has the keys actions and
    observations, each a list of bool arrays that mark changed elements. Start times count from the
    beginning of an episode, random numbers from the last `reset(seed=...)`. `info["final_obs"]` has
    no faults.

    Needs gymnasium (`pip install 'ravenjax[gym]'`).
    """

    def __init__(
        self,
        env: VectorEnv,
        actions: Sequence[faults.Fault] = (),
        observations: Sequence[faults.Fault] = (),
    ) -> None:
        super().__init__(env)
        self._faults = {"actions": actions, "observations": observations}
        self._states: dict[tuple[str, int], faults.State] = {}
        self._tick, self._done = 0, False

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset all environments, or those of `options["reset_mask"]`."""
        observations, info = self.env.reset(seed=seed, options=options)
        self._tick = self._tick if seed is None else 0
        self._reset((options or {}).get("reset_mask", True))
        observations, masks = self._strike("observations", observations)
        return observations, {**info, "faults": {"actions": [], "observations": masks}}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Compute one step with faulty actions, and inject faults into its observations."""
        self._tick += 1
        actions, acted = self._strike("actions", actions)
        observations, reward, terminated, truncated, info = self.env.step(actions)
        ended, self._done = self._done, terminated | truncated
        mode = self.env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        if mode is not AutoresetMode.DISABLED:
            self._reset(self._done if mode is AutoresetMode.SAME_STEP else ended)
        observations, observed = self._strike("observations", observations)
        info = {**info, "faults": {"actions": acted, "observations": observed}}
        return observations, reward, terminated, truncated, info

    def _reset(self, done: Any) -> None:
        self._states = {key: faults.reset(one, done) for key, one in self._states.items()}

    def _strike(self, side: str, signal: Any) -> tuple[Any, list[Any]]:
        # Applies the faults of actions or observations. Returns the signal, and for each fault
        # which elements it changed.
        masks = []
        for key, fault in enumerate(self._faults[side]):
            state = self._states.get((side, key)) or faults.init(signal, fault)
            signal, self._states[side, key], mask = faults.apply(signal, state, self._tick, fault)
            masks.append(mask)
        return signal, masks

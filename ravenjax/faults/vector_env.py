"""Wraps a vector environment of Gymnasium, to inject faults into its actions and observations."""

from collections.abc import Sequence
from typing import Any

from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from ravenjax import faults


class FaultyVectorEnv(VectorWrapper):
    """A Gymnasium `VectorEnv` with faults in its actions or observations.

    The faults of a list change one array [environments, ...], in the order of the list. Faulty
    values may be outside of the action or observation space. `info["faults"]` has the keys actions
    and observations, each a list of bool arrays that mark changed elements. Start times count from
    the beginning of an episode. `reset(seed=...)` restarts the random numbers. `info["final_obs"]`
    has no faults.

    Needs gymnasium (`pip install 'ravenjax[gym]'`).
    """

    def __init__(
        self,
        env: VectorEnv,
        actions: Sequence[faults.Fault] = (),
        observations: Sequence[faults.Fault] = (),
    ):
        super().__init__(env)
        self._faults = {"actions": actions, "observations": observations}
        self._states: dict[tuple[str, int], faults.State] = {}
        self._tick, self._done = 0, False

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset all environments, or the environments that `options["reset_mask"]` marks."""
        observations, info = self.env.reset(seed=seed, options=options)
        # Random numbers depend on the tick, so that they are the same again after the same seed.
        if seed is not None:
            self._tick = 0
        self._reset_faults((options or {}).get("reset_mask", True))
        observations, changed = self._inject("observations", observations)
        return observations, {**info, "faults": {"actions": [], "observations": changed}}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Compute one step with faulty actions, and inject faults into its observations.

        If the environments reset themselves at the end of an episode, the faults are reset too.
        """
        self._tick += 1
        actions, changed_actions = self._inject("actions", actions)
        observations, reward, terminated, truncated, info = self.env.step(actions)
        done_before, self._done = self._done, terminated | truncated
        mode = self.env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        if mode is AutoresetMode.SAME_STEP:
            self._reset_faults(self._done)
        # An environment whose episode ended in the step before has reset itself in this step.
        elif mode is not AutoresetMode.DISABLED:
            self._reset_faults(done_before)
        observations, changed_observations = self._inject("observations", observations)
        changed = {"actions": changed_actions, "observations": changed_observations}
        return observations, reward, terminated, truncated, {**info, "faults": changed}

    def _reset_faults(self, done):
        self._states = {key: faults.reset(state, done) for key, state in self._states.items()}

    def _inject(self, side: str, signal) -> tuple[Any, list[Any]]:
        # Applies the faults of a side, "actions" or "observations". Returns the signal, and for
        # each fault which elements it changed.
        changed_elements = []
        for number, fault in enumerate(self._faults[side]):
            key = (side, number)
            state = self._states.get(key) or faults.init(signal, fault)
            signal, self._states[key], changed = faults.apply(signal, state, self._tick, fault)
            changed_elements.append(changed)
        return signal, changed_elements

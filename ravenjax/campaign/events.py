"""What a stop rule counts: events of runs, from columns of the result table, as the report names and means them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign.config import CampaignConfig
from ravenjax.store.schema import Columns


class Rules(NamedTuple):
    """What the words mean in one campaign."""

    cue: int = 0  # number of the haptic set of the verdict
    threshold_mm: float = 3.0  # its own, mm
    jump: str = "jump_code"  # column of the jump rule


def rules(config: CampaignConfig) -> Rules:
    """Those of a campaign."""
    cue = config.outcomes.cue
    return Rules(cue, config.haptics.cues()[cue].threshold_m * 1e3, f"jump_{config.outcomes.jump}")


def columns(rates: Sequence[str], rules: Rules) -> list[str]:
    """Columns of the result table that `happened` and `valid` need."""
    return list(dict.fromkeys(["index", "failed", *(name for rate in rates for name in _EVENTS[rate][0](rules))]))


def valid(rows: Columns) -> np.ndarray:
    """Which runs have an outcome, bool [rows]."""
    return np.asarray(pd.Categorical(rows["failed"]) == "")


def happened(rate: str, rows: Columns, rules: Rules) -> np.ndarray:
    """Which runs are cases of a rate, bool [rows]; of a run without an outcome it says nothing."""
    return _EVENTS[rate][1](rows, rules)


def _response(word: str) -> Callable[[Columns, Rules], np.ndarray]:
    return lambda rows, _: np.asarray(pd.Categorical(rows["response"]) == word)


def _came_first(rows: Columns, column: str) -> np.ndarray:
    """Whether a time came that the fault-free twin's had not by then."""
    own, twin = np.asarray(rows[column]), np.asarray(rows[f"twin_{column}"])
    return (own >= 0) & ~((twin >= 0) & (twin <= own))


def _evades(rows: Columns, rules: Rules) -> np.ndarray:
    """No check responded and the true tip left the nominal model by more than the cue's threshold."""
    return _response("none")(rows, rules) & (np.asarray(rows["peak_model_deviation_mm"]) > rules.threshold_mm)


def _harm(rows: Columns, rules: Rules) -> np.ndarray:
    """The true tip strayed more than 3 mm while live, and the twin's had not, or a jump."""
    return _came_first(rows, "moved_first_ms") | np.asarray(rows[rules.jump], bool)


_EVENTS: dict[str, tuple[Callable[[Rules], list[str]], Callable[[Columns, Rules], np.ndarray]]] = {
    "evades": (lambda _: ["response", "peak_model_deviation_mm"], _evades),
    "harm": (lambda rules: ["moved_first_ms", "twin_moved_first_ms", rules.jump], _harm),
    "stopped": (lambda _: ["response"], _response("stopped")),
    "flagged": (lambda _: ["response"], _response("flagged")),
    "silent": (lambda _: ["response"], _response("none")),
    "cue": (
        lambda rules: [f"cue{rules.cue}_first_ms"],
        lambda rows, rules: np.asarray(rows[f"cue{rules.cue}_first_ms"]) >= 0,
    ),
    "jump": (lambda rules: [rules.jump], lambda rows, rules: np.asarray(rows[rules.jump], bool)),
    "activated": (lambda _: ["activated"], lambda rows, _: np.asarray(rows["activated"], bool)),
    "diverged": (lambda _: ["diverged"], lambda rows, _: np.asarray(rows["diverged"], bool)),
}
"""Of each rate: the columns that it needs, and which runs are its cases."""

"""Training scenarios: TOML files that declare a task, hazards and the right responses."""

from ravenjax.train.scenario.campaign import armable, campaign
from ravenjax.train.scenario.config import Entry, Harm, Scenario, Speeds
from ravenjax.train.scenario.hazard import Armable
from ravenjax.train.scenario.loading import bundled, from_dict, load

__all__ = [
    "Armable",
    "Entry",
    "Harm",
    "Scenario",
    "Speeds",
    "armable",
    "bundled",
    "campaign",
    "from_dict",
    "load",
]

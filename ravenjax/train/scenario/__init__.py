"""Reads training scenarios: TOML files with a task, hazards, and what trainees should do."""

# ruff: noqa: F401

from ravenjax.train.scenario.campaign import Armable, armable_hazards, session_campaign
from ravenjax.train.scenario.config import Entry, Harm, Scenario, Speeds
from ravenjax.train.scenario.loading import bundled_scenarios, from_dict, load_scenario

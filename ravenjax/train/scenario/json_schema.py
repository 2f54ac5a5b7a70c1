"""JSON Schema of training scenarios."""

from __future__ import annotations

from typing import Any

from ravenjax.campaign.inspection import json_schema
from ravenjax.robots.raven2 import ROBOT
from ravenjax.train.scenario.config import Scenario


def schema() -> dict[str, Any]:
    """JSON Schema of a scenario file."""
    whole = json_schema.of_model(ROBOT, Scenario, "ravenjax scenario")
    fault, entry = whole["$defs"]["Fault"], whole["$defs"]["Entry"]
    fault["required"] = [
        key for key in fault["required"] if key != "start_ms"
    ]  # a fault strikes when its hazard does
    entry["oneOf"] = [{"required": ["hazards"]}, {"required": ["fault"]}]
    return whole

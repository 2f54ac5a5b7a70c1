"""JSON Schema of search files: that of a campaign of one group, with a table [search] of one
kind.
"""

from __future__ import annotations

from typing import Any

from ravenjax.analyses.search.file.config import KINDS
from ravenjax.campaign.inspection import json_schema
from ravenjax.vocabulary.robot import Robot


def schema(robot: Robot) -> dict[str, Any]:
    """JSON Schema of a search file."""
    whole: dict[str, Any] = {**json_schema.schema(robot), "title": "ravenjax search"}
    for name, model in KINDS.items():
        table = model.model_json_schema(ref_template="#/$defs/{model}")
        json_schema.tidy(table)
        table["properties"]["kind"] = {"const": name, "description": "which search"}
        whole["$defs"][model.__name__] = table
    kinds = [{"$ref": f"#/$defs/{model.__name__}"} for model in KINDS.values()]
    whole["properties"]["search"] = {
        "description": "[search]: what is asked of the runs",
        "oneOf": kinds,
    }
    whole["properties"]["group"]["maxItems"] = 1
    whole["required"] = [*whole["required"], "search"]
    return whole

"""Makes the JSON Schema of campaign files, with which an editor completes keys and marks mistakes.

The schema contains keys, types, ranges of single values, and allowed words. It comes from the
models with which `loading` checks a file. Rules that relate several keys are not in the schema, nor
are the ranges of the robot's parameters. `ravenjax check` checks these rules and ranges.
"""

import copy
import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, TypeAdapter

from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import Number
from ravenjax.campaign.file.config import config_class_of
from ravenjax.campaign.file.group import PATHS
from ravenjax.campaign.population import KEY
from ravenjax.hazards import expansion
from ravenjax.numbers import paths
from ravenjax.vocabulary.robot import Robot

Schema = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
TABLE = "Parameters"
"""Name of the schema definition for tables whose keys are paths of parameters."""


def campaign_schema(robot: Robot) -> Schema:
    """Return the JSON Schema of a campaign file for that robot."""
    whole = of_model(robot, config_class_of(robot))
    if robot.hazards:
        _allow_hazards_in_groups(whole, expansion.hazard_words(robot))
    return whole


def of_model(robot: Robot, model: type[BaseModel]) -> Schema:
    """Return the JSON Schema of a file that `model` checks, with the words that a robot permits."""
    whole = {"$schema": DIALECT, **model.model_json_schema()}
    tidy_schema(whole)
    definitions = whole.setdefault("$defs", {})
    if fault := definitions.get("Fault", {}).get("properties"):
        fault["site"]["enum"] = list(robot.sites)
        _restrict_words(fault["arm"], robot.arms)
        _restrict_words(fault["start_ms"], robot.phases)
    # A training scenario has a table [[hazard]] of this class.
    if entry := definitions.get("Entry", {}).get("properties"):
        _restrict_words(entry["hazards"], expansion.hazard_words(robot))
    for table in (whole, *definitions.values()):
        for key in PATHS:
            if key in table.get("properties", ()):
                text = table["properties"][key].get("description", "")
                table["properties"][key] = {"description": text, "$ref": f"#/$defs/{TABLE}"}
    any_path = _paths(robot)
    definitions |= {
        TABLE: _parameters(robot, any_path),
        "ParameterPath": _table({}, any_path) | {"minProperties": 1},
        "ParameterValue": TypeAdapter(Number).json_schema(),
    }
    return whole


def tidy_schema(node: Any) -> None:
    """Remove pydantic's titles, and `minLength` where a value need not be a text, in place."""
    for table in _tables(node):
        if isinstance(table.get("title"), str):
            del table["title"]
        if "anyOf" in table:
            table.pop("minLength", None)
        if isinstance(text := table.get("description"), str):
            # The description may be a docstring of several lines.
            table["description"] = " ".join(text.split())


def _restrict_words(node, words):
    # Restricts every text value in a schema to these words, in place.
    for table in _tables(node):
        if table.get("type") == "string":
            table["enum"] = list(words)


def _tables(node) -> Iterator[Schema]:
    """Yield each table in a schema, before the tables in it. The caller may change it."""
    if isinstance(node, dict):
        yield node
        node = list(node.values())
    for inner in node if isinstance(node, list) else ():
        yield from _tables(inner)


# --- parameters


def _paths(robot: Robot) -> Schema:
    # The schema of a dotted path whose words all occur in parameters of the robot.
    words = paths.path_words(robot.joints).union(
        *(path.split(".") for path, _ in bounds.parameter_bounds(robot)), robot.arms
    )
    # \d+ is an index. The order is fixed, so that the schema is always the same.
    words = {*map(re.escape, words), r"\d+"}
    name = "|".join(sorted(words, key=lambda word: (-len(word), word)))
    return {"pattern": rf"^({name})(\.({name}))*$"}


def _parameters(robot: Robot, any_path: Schema) -> Schema:
    """Return the schema of a table of parameters, whose keys are dotted paths or nested tables. The
    first word of each path must be one of the robot's.
    """
    # Subtrees by word. "" has descriptions of the parameters whose path ends here.
    tree: Schema = {}
    for path, row in bounds.parameter_bounds(robot):
        if not bounds.reserved_reason(robot, path):
            node = tree
            for word in path.split("."):
                node = node.setdefault(word, {})
            of_joints = f" ({', '.join(row.joints)})" if row.joints else ""
            node.setdefault("", []).append(f"{row.meaning}{of_joints}: {row.range}")
    table = _node(tree, any_path)
    text = "in [parameters]: a file with a population, from which robots are drawn"
    table["properties"][KEY] = {"description": text, "type": "string"}
    # The pattern of any path is ^(WORD)(\.(WORD))*$. Here only the first word is another. _OWN is
    # the pattern of paths to parameters in users' Python files.
    first_word = "|".join(map(re.escape, (*tree, KEY)))
    any_pattern = any_path["pattern"]
    more_words = any_pattern[any_pattern.index(r"(\.") :]
    return table | {"propertyNames": {"pattern": f"^({first_word}){more_words}|^{_OWN}$"}}


_OWN = r"((detectors|checks|control|operator)\.own|checks\.threshold)(\.[A-Za-z][A-Za-z0-9_]*)+"
"""Pattern of paths to parameters of users' files, whose names the schema cannot list."""


def _node(tree: Schema, any_path: Schema) -> Schema:
    """Return the schema of a value in a table of parameters: a number or a table if a path ends
    here, else a table with the next words of paths. tree: subtrees by word; "" marks an end.
    """
    if "" in tree:
        return {"description": "; ".join(tree[""]), **_REST}
    return _table({word: _node(below, any_path) for word, below in tree.items()}, any_path)


def _table(properties: Schema, any_path: Schema) -> Schema:
    # Returns the schema of a table of parameters with known keys; other keys may be dotted paths.
    return {
        "type": "object",
        "properties": properties,
        "additionalProperties": _REST,
        "propertyNames": any_path,
    }


_REST: Schema = {"anyOf": [{"$ref": "#/$defs/ParameterValue"}, {"$ref": "#/$defs/ParameterPath"}]}


# --- groups that name hazards


def _allow_hazards_in_groups(schema_of_file: Schema, names: list[str]):
    """Let a group name hazards of the library instead of faults, in place. Such a group has the key
    "hazards", and only keys in `expansion.KEYS`. OVERRIDES are keys of faults that it may set for
    its hazards, and that other groups must not have.
    """
    definitions = schema_of_file["$defs"]
    group, fault = definitions["Group"], definitions["Fault"]["properties"]
    words = {"type": "string", "enum": names}
    choice = {"anyOf": [words, {"type": "array", "items": words, "minItems": 1}]}
    keys: Schema = {expansion.KEY: choice}
    keys |= {key: copy.deepcopy(fault[key]) for key in expansion.OVERRIDES}
    for key, schema in keys.items():
        schema["description"] = f"only in a group that names hazards: {expansion.KEYS[key]}"
        schema.pop("default", None)
    group["properties"] |= keys
    group["if"] = {"required": [expansion.KEY]}
    group["then"] = {"propertyNames": {"enum": list(expansion.KEYS)}}
    group["else"] = {"not": {"anyOf": [{"required": [key]} for key in expansion.OVERRIDES]}}

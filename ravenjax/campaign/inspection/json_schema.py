"""JSON Schema of campaign files, by which an editor completes keys and marks mistakes while a file
is written.

Written from the models that `loading` checks a file with. It knows keys, types, single ranges and
words; what several keys decide together, and the ranges of parameters, only `ravenjax check` tells.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterable
from typing import Any

from pydantic import BaseModel, TypeAdapter

from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import Number
from ravenjax.campaign.file.config import config_class_of
from ravenjax.campaign.file.group import LEAST_MS, LONGEST_MS, PATHS
from ravenjax.campaign.population import KEY
from ravenjax.hazards import expansion
from ravenjax.outcomes import events
from ravenjax.vocabulary.effects import EFFECTS, TRIGGERS
from ravenjax.vocabulary.robot import Robot

Schema = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
TABLE = "Parameters"
"""Definition of a table whose keys are paths of parameters."""


def schema(robot: Robot) -> Schema:
    """JSON Schema of a campaign file of that robot."""
    whole = of_model(robot, config_class_of(robot), "ravenjax campaign")
    _groups(whole)
    return whole


def of_model(robot: Robot, model: type[BaseModel], title: str) -> Schema:
    """JSON Schema of a file that a model checks, with the words that campaigns of a robot share."""
    whole = {"$schema": DIALECT, **model.model_json_schema(), "title": title}
    definitions = whole.setdefault("$defs", {})
    for table in (whole, *definitions.values()):
        tidy(table)
    vocabulary, ranges = _words(robot), config_class_of(robot).ranges()
    for name, table in definitions.items():
        for key, words in vocabulary.get(name, {}).items():
            table["properties"][key] = _among(table["properties"][key], words)
        for key, (low, high) in ranges.get(name, {}).items():
            _numbers(
                table["properties"][key],
                lambda node, a=low, b=high: node | {"minimum": a, "maximum": b},
            )
    if "Fault" in definitions:
        _times(definitions["Fault"]["properties"])
    for table in (whole, *definitions.values()):
        for key in PATHS:
            if key in table.get("properties", ()):
                text = table["properties"][key].get("description", "")
                table["properties"][key] = {"description": text, "$ref": f"#/$defs/{TABLE}"}
    any_path = _paths(robot)
    definitions |= {
        TABLE: _parameters(robot, any_path),
        "ParameterPath": _path(any_path),
        "ParameterValue": TypeAdapter(Number).json_schema(),
    }
    return whole


def _words(robot: Robot) -> dict[str, dict[str, Iterable[str]]]:
    """Definition -> key -> the words that it takes, where the models leave that to a later
    check.
    """
    fault: dict[str, Iterable[str]] = {
        "site": robot.sites,
        "arm": robot.arms,
        "effect": EFFECTS,
        "trigger": TRIGGERS,
    }
    if robot.phases:
        fault["start_ms"] = robot.phases
    return {
        **config_class_of(robot).words(),
        "Fault": fault,
        "Stop": {"rates": events.EVENTS},
        "Entry": {"hazards": expansion.words()},
    }


def tidy(node: Any) -> None:
    """Without pydantic's titles, and without what it leaves beside alternatives."""
    if isinstance(node, dict):
        if isinstance(node.get("title"), str):
            del node["title"]
        if "anyOf" in node:
            node.pop("minLength", None)
        for inner in node.values():
            tidy(inner)
    elif isinstance(node, list):
        for inner in node:
            tidy(inner)


def _replaced(node: Any, fits: Callable[[Schema], bool], by: Callable[[Schema], Schema]) -> Any:
    """A schema in which `by` has replaced each node that `fits`."""
    if isinstance(node, dict):
        if fits(node):
            return by(node)
        return {key: _replaced(inner, fits, by) for key, inner in node.items()}
    return [_replaced(inner, fits, by) for inner in node] if isinstance(node, list) else node


def _among(node: Schema, words: Iterable[str]) -> Schema:
    """A schema whose texts are among `words`."""
    return _replaced(
        node,
        lambda inner: inner.get("type") == "string",
        lambda inner: inner | {"enum": list(words)},
    )


def _numbers(node: Schema, by: Callable[[Schema], Schema]) -> None:
    """Replace every number of a key's schema."""
    new = _replaced(node, lambda inner: inner.get("type") in ("number", "integer"), by)
    node.clear()
    node.update(new)


def _times(fault: dict[str, Schema]) -> None:
    """Ranges of a fault's times, and the word for no end."""
    for key, least in LEAST_MS.items():
        span = {"minimum": least, "maximum": LONGEST_MS}
        options = [
            {"type": "integer", **span},
            *([{"const": "end"}] if key == "duration_ms" else []),
        ]
        fault[key] = _replaced(
            fault[key],
            lambda node: node.get("type") == "integer",
            lambda node, options=options: options[0] if len(options) == 1 else {"anyOf": options},
        )
    fault["duration_ms"]["default"] = "end"


# --- parameters -----------------------------------------------------------------------------------
# --------------------


def _paths(robot: Robot) -> Schema:
    """Names of a table that are words of a path."""
    words = {re.escape(word) for word in (*bounds.names(robot), *robot.arms)} | {r"\d+"}
    name = "|".join(sorted(words, key=lambda word: (-len(word), word)))
    return {"pattern": rf"^({name})(\.({name}))*$"}


def _parameters(robot: Robot, any_path: Schema) -> Schema:
    """A table of parameters: paths, dotted or as tables in tables, of the first words that there
    are.
    """
    tree: Schema = {}
    for path, row in bounds.rows(robot):
        if not bounds.reserved(robot, path):
            node = tree
            for word in path.split("."):
                node = node.setdefault(word, {})
            of = f" ({', '.join(row.joints)})" if row.joints else ""
            node.setdefault("", []).append(f"{row.meaning}{of}: {row.range}")
    table = _node(tree, any_path)
    table["properties"][KEY] = {
        "description": "in [parameters]: a file whose robots are drawn",
        "type": "string",
    }
    first, rest = "|".join(map(re.escape, (*tree, KEY))), any_path["pattern"].partition("(\\.")
    return table | {"propertyNames": {"pattern": f"^({first}){rest[1]}{rest[2]}|^{_OWN}$"}}


_OWN = r"((detectors|checks|control|operator)\.own|checks\.threshold)(\.[A-Za-z][A-Za-z0-9_]*)+"
"""Paths of parameters of parts of one's own: their names only their files know."""


def _node(tree: Schema, any_path: Schema) -> Schema:
    """One word of a path: a number where its path ends, else the words that may follow it."""
    if "" in tree:
        return {"description": "; ".join(tree[""]), **_REST}
    inner = {word: _node(below, any_path) for word, below in tree.items()}
    return {
        "type": "object",
        "properties": inner,
        "additionalProperties": _REST,
        "propertyNames": any_path,
    }


_REST: Schema = {"anyOf": [{"$ref": "#/$defs/ParameterValue"}, {"$ref": "#/$defs/ParameterPath"}]}


def _path(any_path: Schema) -> Schema:
    """The rest of a path whose beginning names an arm, a joint or an axis."""
    return {
        "type": "object",
        "additionalProperties": _REST,
        "propertyNames": any_path,
        "minProperties": 1,
    }


# --- groups that name hazards
# -----------------------------------------------------------------------------------------


def _groups(found: Schema) -> None:
    """Let a group name hazards of the library in place of faults, and then only the keys that
    such a group takes.
    """
    group, fault = found["$defs"]["Group"], found["$defs"]["Fault"]["properties"]
    words = {"type": "string", "enum": expansion.words()}
    keys: Schema = {
        expansion.KEY: {"anyOf": [words, {"type": "array", "items": words, "minItems": 1}]}
    }
    keys |= {key: copy.deepcopy(fault[key]) for key in expansion.OVERRIDES}
    for key, schema in keys.items():
        schema["description"] = f"of a group that names hazards: {expansion.KEYS[key]}"
        schema.pop("default", None)
    group["properties"] |= keys
    group["if"] = {"required": [expansion.KEY]}
    group["then"] = {"propertyNames": {"enum": list(expansion.KEYS)}}
    group["else"] = {"not": {"anyOf": [{"required": [key]} for key in expansion.OVERRIDES]}}

"""The reference of campaign files, as Markdown: every key with its type, unit, range, default and
meaning.

Written from the models, so that it cannot say otherwise than what is checked;
`campaigns/REFERENCE.md` holds it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import DISTRIBUTIONS, FORMS, LIST, PHASE_FORMS, Axis
from ravenjax.campaign.file.config import config_class_of
from ravenjax.campaign.file.group import DESIGNS, LEAST_MS, LONGEST_MS, UNTIL_END, Fault
from ravenjax.campaign.file.sections import CampaignSection
from ravenjax.campaign.loading import header, tables_of
from ravenjax.hazards import library
from ravenjax.hazards.expansion import KEYS
from ravenjax.vocabulary.effects import EFFECTS, TRIGGERS
from ravenjax.vocabulary.robot import Robot

COMMAND = "ravenjax reference --out campaigns/REFERENCE.md"

Ranges = Mapping[str, Mapping[str, tuple[float, float]]]
"""Model of a table -> key -> least and largest number."""

COLUMNS = ("key", "type", "unit", "range", "default", "meaning")
"""Of `keys`."""

WORDS = {
    "run": "one simulated operation of `duration_s`, from a homed robot with the pedal up",
    "group": "runs that share a design; each `[[group]]` of a file is one",
    "arm": "gold or green: each has its own motors, gains of the control software and USB board",
    "golden run": (
        "the same run without its faults: same operator, same parameters, same random numbers; each"
        " run is compared with its own (in names of columns: `golden`)"
    ),
    "nominal model": (
        "a model of the robot that is fed the operator's clean input; the haptic cue pulls when the"
        " robot's reported tip leaves it"
    ),
    "haptic set": (
        "one threshold, spring, damper and cap of the cue; all are evaluated in the same run"
    ),
    "layer": "part of the loop from the operator to the mechanics, L1 to L10",
    "site": "a place on the loop where a fault can strike; a channel is one number there",
    "effect": "what a fault does to the number while its window is open",
    "window": (
        "from `start_ms` after the trigger's clock began, for `duration_ms`, again after each"
        " `every_ms`"
    ),
    "hazard": (
        "an entry of the library: a published fault with values, times and source, run by its id"
    ),
    "parameter": (
        "a number of the robot, its software, the model or the operator that a campaign may vary,"
        " by its path"
    ),
    "detector": "an observer that watches a run and is scored; it does not act",
}

_UNITS = {
    "mrad_s": "mrad/s",
    "rad_s": "rad/s",
    "per_mm_s": "per mm/s",
    "per_mm": "per mm",
    "mm_s": "mm/s",
    "per_s": "1/s",
    "ms": "ms",
    "mm": "mm",
    "hz": "Hz",
    "deg": "deg",
    "s": "s",
    "m": "m",
}
"""Endings of keys, the longest first, and the units that they stand for."""


def page(robot: Robot) -> str:
    """The whole page, for campaigns of that robot."""
    return "\n\n".join(_parts(robot)) + "\n"


def _parts(robot: Robot) -> Iterator[str]:
    config = config_class_of(robot)
    yield "# Campaign files: every key"
    yield (
        f"Written by `{COMMAND}` from what is checked; a test holds it up to date. `ravenjax check"
        " FILE` says what a file would run, `ravenjax faults` and `ravenjax parameters` list the"
        " words below with more about each.\n\nA campaign is a TOML file. Its tables stand in any"
        " order; a table in double brackets may come several times. `--set key.path=value` on the"
        " command line replaces one key: `--set campaign.duration_s=5`, `--set"
        " group.NAME.runs=100`, `--set group.0.fault.0.value=[1, 2]`."
    )
    yield "## Words"
    yield markdown_table(("word", "meaning"), WORDS.items())
    yield "## Values, lists and distributions"
    yield (
        "A key whose type is marked *axis* takes one value, a list, or one of these tables. What"
        " they become in the runs of a group is its `design`."
    )
    yield markdown_table(
        ("table", "meaning"), ((f"`{{ {name} = .. }}`", what) for name, what in FORMS.items())
    )
    yield (
        "A list for a parameter that is a vector (one number a joint or axis) could be meant in"
        " two ways when it is as long as the vector, and is refused: write one path a number, or"
        f" `{{ {LIST} = [..] }}` for values that each hold for all of them. Names take lists and"
        " `{ choice = [..] }`; whole numbers drawn from"
        f" {', '.join(name for name in DISTRIBUTIONS if name != 'choice')} are rounded."
    )
    yield markdown_table(
        ("design", "runs of a group"), ((f"`{name}`", what) for name, what in DESIGNS.items())
    )
    for path, model in tables_of(config):
        if path:
            yield f"## {header(path)}"
            yield sentence(model)
            yield markdown_table(COLUMNS, keys(model, config.ranges()))
        if path == ("group", "run"):
            yield "## [[group]] that names hazards"
            yield (
                "In place of `[[group.fault]]` a group may name hazards of the library; each"
                " becomes one group, or one a case and an arm. Other keys of `[[group]]` it does"
                " not take."
            )
            yield markdown_table(
                ("key", "meaning"), ((f"`{key}`", what) for key, what in KEYS.items())
            )
    yield "## [parameters], [cross]"
    yield (
        "`[parameters]` sets or varies numbers of the robot for every group, `[group.parameters]`"
        " for one; `[cross]` runs every fault once with each value and all else alike, random"
        " numbers too. Keys are paths, each an axis of numbers (a list in `[cross]`). After"
        " `plant`, `nominal`, `control.estimator` and `control.motor_control` a path may name the"
        " arm (`plant.gold.friction_scale`); a vector's path may end in a joint or an axis"
        " (`nominal.gold.kp.elbow`), and means all of them without. `ravenjax parameters` prints"
        " the values that they have."
    )
    yield markdown_table(("path", "range", "meaning"), _parameters(robot))
    yield "## Layers and sites"
    yield markdown_table(("layer", "what it is"), library.layers().items())
    rows = (
        (
            f"`{site.name}`",
            site.layer,
            ", ".join(c.name for c in site.channels),
            "yes" if site.per_arm else "",
            site.where,
        )
        for site in robot.sites.values()
    )
    yield markdown_table(("site", "layer", "channels", "on each arm", "where"), rows)
    yield "## Effects"
    yield markdown_table(
        ("effect", "meaning"), ((f"`{effect.name}`", effect.meaning) for effect in EFFECTS.values())
    )
    yield "## Triggers"
    yield markdown_table(
        ("trigger", "start_ms counts"), ((f"`{name}`", what) for name, what in TRIGGERS.items())
    )
    if robot.phases:
        yield "## Phases"
        yield (
            "With trigger `time`, `start_ms` may be a place in a phase of the operation. Which"
            " milliseconds belong to it follows from the operator's motion at the campaign's setup,"
            " before any fault and the same for all runs; the result table has the milliseconds."
            " `ravenjax check` tells how many there are."
        )
        yield markdown_table(
            ("`start_ms`", "meaning"), ((f"`{form}`", what) for form, what in PHASE_FORMS.items())
        )
        yield markdown_table(
            ("phase", "when"), ((f"`{name}`", when) for name, when in robot.phases.items())
        )
    for table, words in config.words().items():
        if "motion" in words:
            yield "## Motions"
            yield (
                f"`[{table.lower()}] motion` is one of"
                f" {', '.join(f'`{name}`' for name in words['motion'])}."
            )


def sentence(model: type[BaseModel]) -> str:
    """What a model's docstring says of its table, without the table's name."""
    text = " ".join((model.__doc__ or "").split())
    _, _, rest = text.partition(": ")
    return rest[:1].upper() + rest[1:]


def keys(model: type[BaseModel], ranges: Ranges | None = None) -> Iterator[tuple[str, ...]]:
    """One row of COLUMNS for each key of a table but tables inside it. ranges:
    `CampaignConfig.ranges`.
    """
    schema = model.model_json_schema()
    for name, field in model.model_fields.items():
        written = schema["properties"][name]
        inner = _inner(written)
        if "$ref" in inner or "oneOf" in inner or "$ref" in inner.get("items", {}):
            continue  # a table of its own
        yield (
            f"`{name}`",
            _type(name, inner, model),
            _unit(name),
            _range(name, inner, model, (ranges or {}).get(model.__name__, {})),
            _default(field),
            (field.description or "").replace("|", "or"),
        )


def _inner(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """A schema without the null of what may be left out; of a value or a list of it, the list."""
    options = [option for option in schema.get("anyOf", ()) if option.get("type") != "null"]
    if len(options) == 2 and options[1].get("items") == options[0]:
        return options[1]
    return options[0] if len(options) == 1 else schema


def _type(name: str, schema: Mapping[str, Any], model: type[BaseModel]) -> str:
    if any("properties" in option for option in schema.get("anyOf", ())):  # tables of distributions
        return f"{_axis(schema, model, name)}, axis"
    if "anyOf" in schema:
        return ", or ".join(_type(name, option, model) for option in schema["anyOf"])
    kinds = {
        "integer": "whole number",
        "number": "number",
        "boolean": "true or false",
        "string": "text",
    }
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{word}`" for word in schema["enum"])
    if schema["type"] == "object":
        return "paths of numbers, axis"
    if schema["type"] != "array":
        return "path of a file" if schema.get("format") == "path" else kinds[schema["type"]]
    if "prefixItems" in schema:
        return f"two {kinds[schema['prefixItems'][0]['type']]}s"
    items = schema["items"]
    if items.get("type") == "object":
        return "list of tables"
    what = _type(name, items, model) if "enum" in items else kinds[items["type"]]
    return f"list of {what}" if issubclass(model, CampaignSection) else f"{what}, or a list"


def _axis(schema: Mapping[str, Any], model: type[BaseModel], name: str) -> str:
    """What one value of an axis is."""
    if name in LEAST_MS and model is Fault:
        return "whole number"
    return "number" if name == "value" else "name"


def _unit(name: str) -> str:
    return next((unit for ending, unit in _UNITS.items() if name.endswith(f"_{ending}")), "")


def _range(
    name: str,
    schema: Mapping[str, Any],
    model: type[BaseModel],
    ranges: Mapping[str, tuple[float, float]],
) -> str:
    if model is Fault and name in LEAST_MS:
        return f"{LEAST_MS[name]} to {LONGEST_MS}" + (', or "end"' if name == "duration_ms" else "")
    if name in ranges:
        low, high = ranges[name]
        return f"{low:g} to {high:g}"
    numbers = schema.get("items", schema)
    low, high = (
        numbers.get("minimum", numbers.get("exclusiveMinimum")),
        numbers.get("maximum", numbers.get("exclusiveMaximum")),
    )
    spans = []
    if low is not None:
        spans.append(f"above {low:.10g}" if "exclusiveMinimum" in numbers else f"from {low:.10g}")
    if high is not None:
        spans.append(f"below {high:.10g}" if "exclusiveMaximum" in numbers else f"to {high:.10g}")
    if "pattern" in schema:
        spans.append("letters, digits, `_`, `-` and `.`")
    if "maxLength" in schema:
        spans.append(f"at most {schema['maxLength']} letters")
    return ", ".join(spans)


def _default(field: Any) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, Axis):
        value = value.values[0]
        return "`end`" if value == UNTIL_END else f"`{value}`"
    if value is None or value in ((), {}):
        return ""
    if isinstance(value, tuple):
        return f"`{', '.join(map(str, value))}`"
    return "" if value == "" else f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _parameters(robot: Robot) -> Iterator[tuple[str, ...]]:
    for path, row in bounds.rows(robot):
        if not bounds.reserved(robot, path):
            of = f" ({', '.join(row.joints)})" if row.joints else ""
            yield f"`{path}`{of}", row.range, row.meaning


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    cells = [columns, tuple("---" for _ in columns), *rows]
    return "\n".join(
        "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in row) + " |"
        for row in cells
    )

"""Writes the generated pages: campaigns/REFERENCE.md, docs/reference and docs/llms.txt.

    python .ci/reference_pages.py

Each page is written from what it describes, so that it cannot say otherwise than what is checked.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import DISTRIBUTIONS, END, FORMS, LIST, PHASE_FORMS, Axis
from ravenjax.campaign.file.config import config_class_of
from ravenjax.campaign.file.group import DESIGNS
from ravenjax.campaign.file.sections import CampaignSection
from ravenjax.document.html import markdown_table
from ravenjax.errors import tables_of
from ravenjax.hazards import library
from ravenjax.hazards.expansion import KEYS
from ravenjax.robots.raven2 import ROBOT
from ravenjax.vocabulary.effects import EFFECTS, TRIGGERS
from ravenjax.vocabulary.robot import Robot

COMMAND = "python .ci/reference_pages.py"
CHECKOUT = Path(__file__).resolve().parents[1]
_WRITTEN = f"*Written by `{COMMAND}`; a test checks that it is up to date.*"

COLUMNS = ("key", "type", "unit", "range", "default", "meaning")
"""Of `keys`."""

WORDS = {
    "run": "one simulated operation of `duration_s`, from a homed robot with the pedal up",
    "group": "runs that share a design; each `[[group]]` of a file is one",
    "arm": "gold or green: each has its own motors, gains of the control software and USB board",
    "golden run": (
        "reference of a run: the same operator, parameters and random numbers without the faults"
        " (in names of columns: `golden`)"
    ),
    "nominal model": (
        "a model of the robot that receives the operator's input before any fault; the haptic cue"
        " comes when the robot's reported tip is too far from the tip of this model"
    ),
    "haptic set": (
        "one combination of threshold, spring, damper and cap of the cue; a run evaluates all sets"
    ),
    "layer": "part of the loop from the operator to the mechanics, L1 to L10",
    "site": "a place in the control loop where a fault can act; a channel is one number there",
    "effect": "what a fault does to the number while its window is open",
    "window": (
        "the time in which a fault acts: from `start_ms` after the trigger, for `duration_ms`,"
        " repeated every `every_ms`"
    ),
    "hazard": (
        "an entry of the hazard library: a published fault with values, times and source; a"
        " campaign runs it by its id"
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


def campaign_reference(robot: Robot) -> str:
    """The whole page, for campaigns of that robot."""
    return "\n\n".join(_campaign_parts(robot)) + "\n"


def _campaign_parts(robot: Robot) -> Iterator[str]:
    config = config_class_of(robot)
    yield "# Campaign files: every key"
    yield (
        f"Written by `{COMMAND}` from the code; a test checks that this page is up to date."
        " `ravenjax check FILE` shows which runs a file declares. `ravenjax faults` and `ravenjax"
        " parameters` list fault sites, effects, hazards and parameters.\n\nA campaign is a TOML"
        " file. Its tables may be in any order. A table in double brackets may occur several"
        " times. `--set key.path=value` on the command line replaces one key: `--set"
        " campaign.duration_s=5`, `--set group.NAME.runs=100`, `--set"
        " group.0.fault.0.value=[1, 2]`."
    )
    yield "## Words"
    yield markdown_table(("word", "meaning"), WORDS.items())
    yield "## Values, lists and distributions"
    yield (
        "A key whose type is marked *axis* accepts one value, a list, or one of the tables below."
        " The `design` of a group determines how lists and distributions become runs."
    )
    yield markdown_table(
        ("table", "meaning"), ((f"`{{ {name} = .. }}`", what) for name, what in FORMS.items())
    )
    yield (
        "Some parameters are vectors, with one number per joint or axis. A list that is as long"
        " as the vector is ambiguous, and ravenjax refuses it. Write one path per number, or"
        f" `{{ {LIST} = [..] }}` for values that each apply to all numbers of the vector. Keys for"
        " names accept lists and `{ choice = [..] }`. Whole numbers that are drawn from"
        f" {', '.join(name for name in DISTRIBUTIONS if name != 'choice')} are rounded."
    )
    yield markdown_table(
        ("design", "runs of a group"), ((f"`{name}`", what) for name, what in DESIGNS.items())
    )
    for path, header, model in tables_of(config):
        if path:
            yield f"## {header}"
            yield sentence(model)
            yield markdown_table(COLUMNS, key_rows(model))
        if path == ("group", "run"):
            yield "## [[group]] that names hazards"
            yield (
                "Instead of `[[group.fault]]`, a group may list hazards of the library. Each hazard"
                " becomes one group, or several groups if it has several cases or arms. Such a"
                " group accepts only the following keys."
            )
            yield markdown_table(
                ("key", "meaning"), ((f"`{key}`", what) for key, what in KEYS.items())
            )
    yield "## [parameters], [cross]"
    yield (
        "`[parameters]` sets or varies parameters of the robot for every group, and"
        " `[group.parameters]` for one group. `[cross]` runs every fault once with each value; all"
        " other settings and the random numbers are equal. Keys are paths of parameters, and each"
        " is an axis of numbers (a list in `[cross]`). After `plant`, `nominal`,"
        " `control.estimator` and `control.motor_control` a path may contain the arm"
        " (`plant.gold.friction_scale`). The path of a vector may end in a joint or an axis"
        " (`nominal.gold.kp.elbow`); otherwise it sets all numbers of the vector. `ravenjax"
        " parameters` prints the present values."
    )
    yield markdown_table(("path", "range", "meaning"), _parameter_rows(robot))
    yield "## Layers and sites"
    yield markdown_table(("layer", "what it is"), library.library_layers().items())
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
            "With trigger `time`, `start_ms` may be a time in a phase of the operation. The"
            " operator's planned motion, without faults, determines which milliseconds belong to a"
            " phase; they are equal for all runs. The result table contains the start in"
            " milliseconds. `ravenjax check` prints the length of each phase."
        )
        yield markdown_table(
            ("`start_ms`", "meaning"), ((f"`{form}`", what) for form, what in PHASE_FORMS.items())
        )
        yield markdown_table(
            ("phase", "when"), ((f"`{name}`", when) for name, when in robot.phases.items())
        )


def sentence(model: type[BaseModel]) -> str:
    """What a model's docstring says of its table, without the table's name."""
    text = " ".join((model.__doc__ or "").split())
    _, _, rest = text.partition(": ")
    return rest[:1].upper() + rest[1:]


def key_rows(model: type[BaseModel]) -> Iterator[tuple[str, ...]]:
    """One row of COLUMNS for each key of a table but tables inside it."""
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
            _range(inner),
            _default(field),
            (field.description or "").replace("|", "or"),
        )


_TABLES = ("columns", "topics", "sensors", "rotation", "offset_mm")
"""Keys that may be tables of plain values."""


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
        options = [option for option in schema["anyOf"] if option.get("type") != "null"]
        return ", or ".join(_type(name, option, model) for option in options)
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
        return "table" if name in _TABLES else "paths of numbers, axis"
    if schema["type"] != "array":
        return "path of a file" if schema.get("format") == "path" else kinds[schema["type"]]
    if "prefixItems" in schema:
        number = {2: "two", 3: "three", 4: "four"}[len(schema["prefixItems"])]
        return f"{number} {kinds.get(schema['prefixItems'][0]['type'], 'row')}s"
    items = schema["items"]
    if items.get("type") == "object":
        return "list of tables"
    what = _type(name, items, model) if "enum" in items else kinds[items["type"]]
    return f"list of {what}" if issubclass(model, CampaignSection) else f"{what}, or a list"


def _axis(schema: Mapping[str, Any], model: type[BaseModel], name: str) -> str:
    """What one value of an axis is."""
    if name.endswith("_ms"):
        return "whole number"
    return "number" if name == "value" else "name"


def _unit(name: str) -> str:
    return next((unit for ending, unit in _UNITS.items() if name.endswith(f"_{ending}")), "")


def _range(schema: Mapping[str, Any]) -> str:
    if any("properties" in option for option in schema.get("anyOf", ())):  # an axis: of its values
        schema = schema["anyOf"][0]
        if "anyOf" in schema:
            first, other = schema["anyOf"]
            return _range(first) + (f', or "{END}"' if "const" in other else "")
    numbers = schema.get("items", schema.get("prefixItems", [schema])[0])
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
        return f"`{value}`"
    if value is None or value in ((), {}):
        return ""
    if isinstance(value, tuple):
        return f"`{', '.join(map(str, value))}`"
    return "" if value == "" else f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _parameter_rows(robot: Robot) -> Iterator[tuple[str, ...]]:
    for path, row in bounds.parameter_bounds(robot):
        if not bounds.reserved_reason(robot, path):
            of = f" ({', '.join(row.joints)})" if row.joints else ""
            yield f"`{path}`{of}", row.range, row.meaning


def files() -> dict[Path, str]:
    """The text of every generated page by its path."""
    reference = {
        CHECKOUT / "campaigns/REFERENCE.md": campaign_reference(ROBOT),
        CHECKOUT / "docs/llms.txt": "\n\n".join(_overview()) + "\n",
    }
    return reference | {CHECKOUT / "docs/reference" / name: text for name, text in pages().items()}


def _overview() -> Iterator[str]:
    """The site for programs that read it, after https://llmstxt.org."""
    import ravenjax

    navigation = (CHECKOUT / ".mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    commands = re.findall(
        r"^## (ravenjax [\w -]+)\n\n```console\n.*?```\n\n(.*?)(?=^## |\Z)",
        "\n\n".join(_commands()),
        re.M | re.S,
    )
    yield "# ravenjax"
    yield "> Fault injection for a virtual Raven-II surgical robot, on CPUs and GPUs."
    yield "## Pages"
    yield "\n".join(
        f"- [{title}]({page})"
        for title, page in re.findall(
            r'^ +- "?([^"\n]+)"?: (\S+\.(?:md|ipynb))$', navigation, re.MULTILINE
        )
    )
    yield "## Commands"
    yield "\n".join(
        f"- `{name}`{' (`--json`)' if '--json' in text else ''}: {_first_sentence(text)}"
        for name, text in commands
    )
    yield "## JSON Schemas of the files that people write"
    yield "\n".join(f"- `ravenjax schema {kind}`" for kind in ("campaign", "search", "scenario"))
    yield "## Python API: `import ravenjax as rj`"
    yield "\n".join(
        f"- `rj.{name}`: {_first_sentence(inspect.getdoc(getattr(ravenjax, name)) or '')}"
        for name in ravenjax.__all__
    )


def _first_sentence(text: str) -> str:
    """Up to the first full stop, on one line."""
    return " ".join(re.split(r"(?<=\.)\s|\n\n", text.strip(), maxsplit=1)[0].split())


def pages() -> dict[str, str]:
    """Every page by the name of its file."""
    contents = {
        "commands.md": _commands(),
        "campaigns.md": _campaigns(),
        "searches.md": _searches(),
        "scenarios.md": _scenarios(),
        "parameters.md": _parameters(),
        "columns.md": _columns(),
        "hazards.md": _hazards(),
        "python.md": _python(),
    }
    return {name: "\n\n".join(parts) + "\n" for name, parts in contents.items()}


def _commands() -> Iterator[str]:
    from ravenjax.cli import app

    text = app.generate_docs(output_format="markdown")
    text = re.sub(r" -m [\w.]+(?= )", "", text)  # how this Python was started
    _, _, body = text.partition("\n## ravenjax run")
    yield "# Commands"
    yield _WRITTEN
    yield "`ravenjax COMMAND --help` prints the same. Exit codes stand at `ravenjax run`."
    yield "## ravenjax run" + body.rstrip()


def _campaigns() -> Iterator[str]:
    yield '--8<-- "campaigns/REFERENCE.md"'


def _searches() -> Iterator[str]:
    from ravenjax.analyses.search.file.config import KINDS

    yield "# Search files"
    yield _WRITTEN
    yield (
        "A search file is a [campaign file](campaigns.md) of one group, with a table `[search]`."
        " In this group, lists define the cases, and distributions define the searched inputs."
        " `ravenjax search FILE` runs it."
    )
    for name, model in KINDS.items():
        yield f'## [search] kind = "{name}"'
        yield from _keys(model)


def _scenarios() -> Iterator[str]:
    from ravenjax.campaign.file.group import Fault
    from ravenjax.robots.raven2.campaign.sections import Start
    from ravenjax.train.scenario.config import (
        TASKS,
        ContactSection,
        Cue,
        Entry,
        Harm,
        Level,
        RobotSection,
        Scenario,
        Speeds,
    )

    yield "# Training scenarios"
    yield _WRITTEN
    yield (
        "A scenario is a TOML file; `ravenjax train FILE` runs it. The following keys belong at"
        " the top of the file, before any table."
    )
    yield from _keys(Scenario)
    tables = {
        "[speeds]": Speeds,
        "[cue]": Cue,
        "[contact]": ContactSection,
        "[harm]": Harm,
        "[robot]": RobotSection,
        "[robot.start]": Start,
    }
    tasks = {f'[task] kind = "{name}"': model for name, model in TASKS.items()}
    for title, model in {**tasks, "[[task.level]]": Level, "[[hazard]]": Entry, **tables}.items():
        yield f"## {title}"
        yield from _keys(model)
    yield "## [[hazard.fault]]"
    yield (
        "This table has the same keys as `[[group.fault]]` of a [campaign](campaigns.md):"
        f" {', '.join(f'`{key}`' for key in Fault.model_fields)}. The default of"
        " `start_ms` is the start of the hazard."
    )
    yield "## [parameters]"
    yield (
        "Parameters of the robot, with the same keys as `[parameters]` of a campaign. If a value is"
        " a list or a distribution, a session draws one value from it."
    )


def _keys(model: type[BaseModel]) -> Iterator[str]:
    yield sentence(model)
    yield markdown_table(COLUMNS, key_rows(model))


def _parameters() -> Iterator[str]:
    from ravenjax.campaign import loading
    from ravenjax.campaign.file import bounds
    from ravenjax.cli.catalogue import PARAMETER_COLUMNS, parameter_rows

    config = loading.from_dict({"campaign": {"name": "plain"}, "group": [{"name": "plain"}]})
    rows = [
        row for row in parameter_rows(config) if not bounds.reserved_reason(config.robot, row[0])
    ]
    yield "# Parameters"
    yield _WRITTEN
    yield (
        "This page lists the parameters that you can write in `[parameters]` and `[cross]` of a"
        " campaign. The column *value* gives the default for a robot with one gold arm and the"
        " software raven2. `ravenjax parameters FILE` prints the parameters of the robot of a"
        " campaign. A parameter is one number, or several numbers, one for each joint or axis. To"
        " change the number of one joint only, add the joint to the path: `PATH.elbow`."
    )
    yield markdown_table(PARAMETER_COLUMNS, ((f"`{path}`", *rest) for path, *rest in rows))


def _columns() -> Iterator[str]:
    from ravenjax.outcomes import events
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.robots.raven2.loop.optional import STAGES
    from ravenjax.store import schema

    shape = schema.Shape(
        arms=("<arm>",),
        joints=("<joint>",),
        checks=("<check>",),
        parameters=("<path>",),
        stages=tuple(STAGES),
        detectors=(1,),
        harms=("<name>",),
        observes=True,
    )
    yield "# Result columns"
    yield _WRITTEN
    yield (
        f"The result table has one row per run. Its schema version is {schema.VERSION}. `<k>`"
        " counts fault slots, haptic sets (in the order of `cues` in manifest.json) or thresholds"
        " of a detector, from 0. `<d>` counts detectors in the order of `detectors`. Times count"
        " from the start of the run; -1 means never. The prefix `golden_` marks columns of the"
        " run's [golden run](../glossary.md). `results/README.md` describes the result folder."
    )
    numbered = (
        (_numbered(c.name), c.dtype, c.unit, c.meaning) for c in schema.table_columns(shape)
    )
    yield markdown_table(
        ("column", "type", "unit", "meaning"), ((f"`{name}`", *rest) for name, *rest in numbered)
    )
    yield "## Checks"
    yield (
        "Each built-in check has the columns `check_<check>_first_ms`, `_count` and `_margin`."
        " *stop*: the robot stops; *flag*: the check raises an alarm; *limit*: a command"
        " is changed or a packet is dropped, without an alarm."
    )
    every = ROBOT.checks.values()
    yield markdown_table(
        ("check", "unit of its margin", "looks at", "does"),
        ((f"`{one.name}`", one.unit, one.meaning, one.action) for one in every),
    )
    yield "## Events"
    yield (
        "The table `[stop] rates` of a campaign and the key `harm` of a search accept these"
        " events. An event is an expression over the columns above."
    )
    rules = events.Rules()
    yield markdown_table(
        ("event", "a run in which ..."),
        ((f"`{name}`", events.event_meaning(name, rules)) for name in events.EVENTS),
    )


def _numbered(column: str) -> str:
    """Numbers of repeated columns as letters."""
    column = re.sub(r"^(golden_)?detector\d+", r"\1detector<d>", column)
    return re.sub(r"(fault|applied|cue|level)\d+", r"\1<k>", column)


def _hazards() -> Iterator[str]:
    from ravenjax.hazards import listing

    rows = listing.hazard_table(library.all_hazards())
    runs = sum(1 for row in rows if row[-1] == "yes")
    yield "# Hazard library"
    yield _WRITTEN
    yield (
        f"The library has {len(rows)} published hazards. ravenjax can simulate {runs} of them."
        " `ravenjax faults ID` prints the values, trigger, expected outcome and source of a hazard."
        ' `hazards = ["C09", "L7"]` in a group runs them.'
    )
    yield markdown_table(listing.LAYER_COLUMNS, listing.layer_table(ROBOT))
    yield markdown_table(listing.COLUMNS, rows)


def _python() -> Iterator[str]:
    import ravenjax
    from ravenjax.campaign.file.section import Section
    from ravenjax.faults import vector_env

    yield "# Python API"
    yield _WRITTEN
    yield (
        "Import the package with `import ravenjax as rj`. The names on this page are public, with"
        " the arguments, results and errors that this page describes. Everything else is internal:"
        " other modules, classes and functions of the package may move, change or be removed in any"
        " version."
    )
    members = vars(ravenjax.functional)
    things = {name: getattr(ravenjax, name) for name in ravenjax.__all__} | {
        f"functional.{name}": members[name] for name in ("Model", "Rollout", "load")
    }
    things |= {f"faults.{name}": vars(ravenjax.faults)[name] for name in ravenjax.faults.__all__}
    things["faults.vector_env.FaultyVectorEnv"] = vector_env.FaultyVectorEnv
    for name, thing in sorted(things.items()):
        yield f"## {name}"
        if inspect.isclass(thing) and issubclass(thing, Section) and name != "CampaignConfig":
            keys = ", ".join(f"`{key}`" for key in inspect.signature(thing).parameters)
            summary = _prose(thing).partition("\n\n")[0].replace("\n", " ")
            yield f"{summary} Its [keys](campaigns.md): {keys}."
            continue
        plain = inspect.ismodule(thing) or (
            inspect.isclass(thing) and issubclass(thing, BaseModel | Exception | tuple)
        )
        if not plain:
            yield f"```text\n{_signature(name, thing)}\n```"
        yield _prose(thing)
        if not plain and inspect.isclass(thing):
            for inner, method in inspect.getmembers(thing, inspect.isroutine):
                if not inner.startswith("_") and method.__doc__:
                    yield f"### {name}.{inner}"
                    yield f"```text\n{_signature(f'{name}.{inner}', method)}\n```"
                    yield _prose(method)


def _signature(name: str, thing: object) -> str:
    """How it is called, one parameter a line where there are several."""
    signature = inspect.signature(thing)  # pyright: ignore[reportArgumentType]
    written = [_parameter(one) for one in signature.parameters.values() if one.name != "self"]
    result = (
        f" -> {signature.return_annotation}"
        if signature.return_annotation not in (signature.empty, None, "None")
        else ""
    )
    joined = ", ".join(written)
    if len(f"{name}({joined}){result}") > 88:
        joined = "\n    " + ",\n    ".join(written) + ",\n"
    return f"{name}({joined}){result}"


def _parameter(one: inspect.Parameter) -> str:
    kind = "" if one.annotation is one.empty else f": {one.annotation}"
    return f"{one.name}{kind}" + ("" if one.default is one.empty else f" = {one.default!r}")


def _prose(thing: object) -> str:
    return _escaped(inspect.getdoc(thing) or "")


def _escaped(text: str) -> str:
    """Text in which Markdown takes nothing for a tag."""
    return text.replace("<", "&lt;")


def main() -> None:
    """Write every page."""
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path.relative_to(CHECKOUT)}")


if __name__ == "__main__":
    main()

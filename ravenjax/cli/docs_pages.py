"""The reference pages of the documentation, as Markdown, each written from what it describes."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

from pydantic import BaseModel

from ravenjax.campaign.inspection.reference import markdown_table

COMMAND = "ravenjax reference --pages docs/reference"

_WRITTEN = f"*Written by `{COMMAND}`; a test holds it up to date.*"


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
        " The group is the template: its lists are the cases, its distributions the inputs."
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
        "A scenario is a TOML file; `ravenjax train FILE` runs it. These keys stand at its top,"
        " before any table."
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
        "As `[[group.fault]]` of a [campaign](campaigns.md):"
        f" {', '.join(f'`{key}`' for key in Fault.model_fields)}. `start_ms` may be left out: the"
        " fault strikes when its hazard does."
    )
    yield "## [parameters]"
    yield "As in a campaign; of a list or a distribution a session draws one value."


def _keys(model: type[BaseModel]) -> Iterator[str]:
    from ravenjax.campaign.inspection import reference
    from ravenjax.robots.raven2.campaign.config import RavenConfig

    yield reference.sentence(model)
    yield markdown_table(reference.COLUMNS, reference.keys(model, RavenConfig.ranges()))


def _parameters() -> Iterator[str]:
    from ravenjax.campaign import loading
    from ravenjax.campaign.file import bounds
    from ravenjax.cli.catalogue import PARAMETER_COLUMNS, parameter_rows

    config = loading.from_dict({"campaign": {"name": "plain"}, "group": [{"name": "plain"}]})
    rows = [row for row in parameter_rows(config) if not bounds.reserved(config.robot, row[0])]
    yield "# Parameters"
    yield _WRITTEN
    yield (
        "What `[parameters]` and `[cross]` may set or vary, with the values of one gold arm under"
        " the software raven2. `ravenjax parameters FILE` prints those of a campaign's own robot."
        " One path names one number, or a vector of one number a joint or axis; `PATH.elbow` names"
        " the elbow's alone."
    )
    yield markdown_table(PARAMETER_COLUMNS, ((f"`{path}`", *rest) for path, *rest in rows))


def _columns() -> Iterator[str]:
    from ravenjax.outcomes import events
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.store import schema

    shape = schema.Shape(
        arms=("<arm>",),
        joints=("<joint>",),
        checks=("<check>",),
        parameters=("<path>",),
        reacts=True,
        hand_yields=True,
        cables=True,
        contact=True,
        detectors=(1,),
        observes=True,
    )
    yield "# Result columns"
    yield _WRITTEN
    yield (
        f"One row a run, schema version {schema.VERSION}. `<k>` and `<d>` count from 0: fault"
        " slots, haptic sets in the order of `cues` in manifest.json, detectors in the order of"
        " `detectors`, thresholds of a detector. Times count from the start of the run; -1 means"
        " never. `golden_` marks what is kept of the run's [golden run](../glossary.md)."
        " `results/README.md` describes the folder around the table."
    )
    numbered = ((_numbered(c.name), c.dtype, c.unit, c.meaning) for c in schema.columns(shape))
    yield markdown_table(
        ("column", "type", "unit", "meaning"), ((f"`{name}`", *rest) for name, *rest in numbered)
    )
    yield "## Checks"
    yield (
        "Each built-in check has the columns `check_<check>_first_ms`, `_count` and `_margin`."
        " *stop*: the robot stops; *flag*: a person is told; *limit*: a command is changed or a"
        " packet is dropped, and nobody is told."
    )
    every = ROBOT.checks.values()
    yield markdown_table(
        ("check", "unit of its margin", "looks at", "does"),
        ((f"`{one.name}`", one.unit, one.meaning, one.action) for one in every),
    )
    yield "## Events"
    yield (
        "Names for `[stop] rates` and for searches; the report prints their rates. Each is an"
        " expression over the columns above."
    )
    rules = events.Rules()
    yield markdown_table(
        ("event", "a run in which ..."),
        ((f"`{name}`", events.meaning(name, rules)) for name in events.EVENTS),
    )


def _numbered(column: str) -> str:
    """Numbers of repeated columns as letters."""
    column = re.sub(r"^(golden_)?detector\d+", r"\1detector<d>", column)
    return re.sub(r"(fault|applied|cue|level)\d+", r"\1<k>", column)


def _hazards() -> Iterator[str]:
    from ravenjax.hazards import listing

    rows = listing.table()
    runs = sum(1 for row in rows if row[-1] == "yes")
    yield "# Hazard library"
    yield _WRITTEN
    yield (
        f"{len(rows)} published hazards, of which the simulator runs {runs}. `ravenjax faults ID`"
        " prints all that is known of one: values, trigger, expected outcome, source. A group runs"
        ' them by `hazards = ["C09", "L7"]`.'
    )
    yield markdown_table(listing.LAYER_COLUMNS, listing.layers())
    yield markdown_table(listing.COLUMNS, rows)


def _python() -> Iterator[str]:
    import ravenjax
    from ravenjax.campaign.file.section import Section

    yield "# Python API"
    yield _WRITTEN
    yield (
        "`import ravenjax as rj`. The names on this page are public, and so is what their texts say"
        " of arguments, results and errors. Everything that is not on this page is internal:"
        " modules, classes and functions that can be imported from the package's folders may move,"
        " change or go with any version."
    )
    for name in ravenjax.__all__:
        thing = getattr(ravenjax, name)
        yield f"## {name}"
        if inspect.isclass(thing) and issubclass(thing, Section) and name != "CampaignConfig":
            keys = ", ".join(f"`{key}`" for key in inspect.signature(thing).parameters)
            summary = _prose(thing).partition("\n\n")[0].replace("\n", " ")
            yield f"{summary} Its [keys](campaigns.md): {keys}."
            continue
        plain = inspect.isclass(thing) and issubclass(thing, BaseModel | Exception)
        if not plain:
            yield f"```text\n{_signature(name, thing)}\n```"
        yield _prose(thing)
        if inspect.isclass(thing) and not plain:
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

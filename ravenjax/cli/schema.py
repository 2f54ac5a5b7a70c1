"""`reference` and `schema`: the files that people write, described for them and their editors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ravenjax.cli import console

Kind = Literal["campaign", "search", "scenario"]
Out = Annotated[Path | None, Parameter(help="write it to this file; default: print it")]


def reference(*, out: Out = None) -> None:
    """Print the reference of campaign files: every key with its type, unit, range, default and
    meaning (Markdown).
    """
    from ravenjax.bundled import resources

    file = resources.find("campaigns", "REFERENCE.md")
    _print_or_write(file.read_text(encoding="utf-8"), out)


def schema(kind: Kind = "campaign", *, out: Out = None) -> None:
    """Print the JSON Schema of campaign, search or scenario files, for editors.

    Editors with Taplo use it if the first line of the TOML file is `#:schema
    campaign.schema.json`.

    Parameters
    ----------
    kind
        Of which files.
    """
    import json

    from ravenjax.robots.raven2 import ROBOT

    if kind == "search":
        from ravenjax.analyses.search.file import config as searches

        content = searches.json_schema_of(ROBOT)
    elif kind == "scenario":
        from ravenjax.train.scenario import loading

        content = loading.json_schema()
    else:
        from ravenjax.campaign.inspection import json_schema

        content = json_schema.schema(ROBOT)
    _print_or_write(json.dumps(content, indent=1, ensure_ascii=False) + "\n", out)


def _print_or_write(text: str, out: Path | None) -> None:
    if out is None:
        print(text, end="", file=console.out.file)
        return
    from ravenjax.store import files

    files.write_aside(out, lambda target: target.write_text(text, encoding="utf-8"))
    console.say(f"wrote {out}")

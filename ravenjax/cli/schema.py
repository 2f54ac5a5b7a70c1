"""`schema`: the files that people write, as JSON Schema for their editors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ravenjax.cli import console


def schema(
    kind: Literal["campaign", "search", "scenario"] = "campaign",
    *,
    out: Annotated[Path | None, Parameter(help="write it to this file; default: print it")] = None,
) -> None:
    """Print the JSON Schema of campaign, search or scenario files: an editor completes and checks
    keys by it.

    Taplo and the editors that use it take it from a line at the top of the TOML file: `#:schema
    campaign.schema.json`.

    Parameters
    ----------
    kind
        Of which files.
    """
    import json

    text = json.dumps(_schema(kind), indent=1, ensure_ascii=False) + "\n"
    if out is None:
        print(text, end="", file=console.out.file)
        return
    from ravenjax.store import files

    files.write_aside(out, lambda target: target.write_text(text, encoding="utf-8"))
    console.out.print(f"wrote {out}", highlight=False, soft_wrap=True)


def _schema(kind: str) -> dict[str, object]:
    from ravenjax import robots

    robot = robots.find(robots.DEFAULT)
    if kind == "search":
        from ravenjax.analyses.search.file import json_schema

        return json_schema.schema(robot)
    if kind == "scenario":
        from ravenjax.train.scenario import json_schema

        return json_schema.schema()
    from ravenjax.campaign.inspection import json_schema

    return json_schema.schema(robot)

"""The command `schema`: prints the JSON Schema of the files that users write, for their editors."""

from pathlib import Path
from typing import Literal

from ravenjax.cli import console

Kind = Literal["campaign", "search", "scenario"]


def schema(kind: Kind = "campaign", *, out: Path | None = None) -> None:
    """Print the JSON Schema of campaign, search or scenario files, for editors.

    Editors with Taplo use it if the first line of the TOML file is `#:schema
    campaign.schema.json`.

    Parameters
    ----------
    kind
        Kind of file that the schema describes.
    out
        write it to this file; default: print it
    """
    import json

    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.store import files

    if kind == "search":
        from ravenjax.analyses.search.file import config as searches

        content = searches.json_schema_of(ROBOT)
    elif kind == "scenario":
        from ravenjax.train.scenario import loading

        content = loading.json_schema()
    else:
        from ravenjax.campaign.inspection import json_schema

        content = json_schema.campaign_schema(ROBOT)
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    if out is None:
        print(text, end="", file=console.out.file)
        return
    files.write_text(out, text)
    console.print_text(f"wrote {out}")

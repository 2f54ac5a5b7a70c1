"""The commands `ravenjax explore`, `ravenjax export` and `ravenjax schema`.

`explore` writes a page that simulates faults, `export` writes a robot as a C library, and `schema`
prints the schema of campaign, search and scenario files.
"""

import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Words
from ravenjax.errors import UserError

Kind = Literal["campaign", "search", "scenario"]


def explore(
    *sources: str,
    out: Annotated[Path | None, Parameter(name=("--out", "-o"))] = None,
    gallery: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Write an HTML page that simulates faults of a campaign in any browser.

    The page contains the robot, its control software and its checks as WebAssembly. It is one
    file and needs no network. The page of a result folder also shows the runs of the folder.

    Args:
        sources: Campaign file, the name of a bundled campaign (see `ravenjax campaigns`), or a
            result folder that `ravenjax run` wrote.
        out: file of the page; default NAME.explore.html, or DIR/explore.html
        gallery: folder for the pages of several campaigns and an index; default all bundled
            campaigns
    """
    from ravenjax.analyses.explorer import gallery as galleries
    from ravenjax.analyses.explorer import page

    if gallery is not None:
        if out is not None:
            raise UserError(
                "got --out and --gallery; leave out --out, because the pages of a gallery are named"
                " after their campaigns"
            )
        cards = galleries.build_gallery(gallery, sources)
        index = gallery / galleries.INDEX
        if as_json:
            return console.emit_json({"index": index, "campaigns": [vars(card) for card in cards]})
        for card in cards:
            console.print_text(f"{card.campaign}: {card.file or 'no page, ' + card.reason}")
        return console.print_text(index)
    if len(sources) != 1:
        raise UserError(
            f"got {len(sources)} campaigns, expected one; for one page each, add --gallery DIR"
        )
    path = page.build_page(sources[0], out)
    if as_json:
        return console.emit_json({"page": path, "bytes": path.stat().st_size})
    return console.print_text(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")


def export(
    folder: Path,
    *,
    arms: Words = None,
    tools: Words = None,
    policy: str = "soft_regulation",
    level: str | None = None,
    parameter_set: str = "power_consistent",
    cpu: Literal["portable", "native"] = "portable",
    as_json: AsJson = False,
) -> None:
    """Write the control software and the virtual robot as a C library.

    The folder contains a header, an object file, a shared library and an example. The software and
    the robot each have one function `step`, which computes one millisecond on plain structs. It
    allocates no memory and gives the same bits as `rj.ControlSoftware` and `rj.VirtualRobot`. Only
    the shared library needs a C compiler.

    Args:
        folder: Folder to write into; files of an earlier export there are replaced.
        arms: gold, green or both
        tools: one for each arm
        policy: no_regulation, soft_regulation or hard_regulation
        level: level of the overdrive check: beginner, moderate, advanced
        parameter_set: mechanics of the virtual robot
        cpu: portable: any CPU of this architecture; native: this CPU. Results have the same bits
    """
    from ravenjax.analyses import c_folder
    from ravenjax.robots.raven2.software.control_software import ControlSoftware
    from ravenjax.robots.raven2.virtual_robot import VirtualRobot

    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder} is a file, expected a folder to write into")
    software = ControlSoftware(
        arms=arms or ("gold", "green"),  # type: ignore[arg-type]
        tools=tools,
        policy=policy,  # type: ignore[arg-type]
        level=level,  # type: ignore[arg-type]
    )
    robot = VirtualRobot(software.setup.arms, software.setup.tools, parameter_set)
    written = c_folder.write_library(folder, software, robot, cpu)
    if as_json:
        return console.emit_json(written)
    # Without a C compiler, the path of the shared library is None.
    for path in written:
        if path is not None:
            console.print_text(path)
    if written.shared is None:
        console.print_note(
            f"found no C compiler ({', '.join(c_folder.COMPILERS)}), so no shared library was"
            f" linked. Link {written.object} and the C library's mathematics (-lm) into your"
            " program"
        )
    return None


def schema(kind: Kind = "campaign", *, out: Path | None = None) -> None:
    """Print the JSON Schema of campaign, search or scenario files, for editors.

    Editors with Taplo use the schema if the first line of the TOML file is `#:schema
    campaign.schema.json`.

    Args:
        kind: Kind of file that the schema describes.
        out: file to write; default: print the schema
    """
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.store import files

    # Only the imports that the kind of file needs are made, because they are slow.
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

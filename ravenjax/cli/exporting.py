"""`export`: control software and virtual robot for C programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson


def export(
    folder: Path,
    *,
    arms: Annotated[
        list[str] | None, Parameter(consume_multiple=True, negative="", help="gold, green or both")
    ] = None,
    tools: Annotated[
        list[str] | None, Parameter(consume_multiple=True, negative="", help="one an arm")
    ] = None,
    policy: Annotated[
        str, Parameter(help="no_regulation, soft_regulation or hard_regulation")
    ] = "soft_regulation",
    level: Annotated[
        str | None, Parameter(help="overdrive level: beginner, moderate, advanced")
    ] = None,
    parameter_set: Annotated[
        str, Parameter(help="mechanics of the virtual robot")
    ] = "power_consistent",
    cpu: Annotated[
        Literal["portable", "native"],
        Parameter(help="portable: any CPU of this kind; native: this one; the same bits"),
    ] = "portable",
    as_json: AsJson = False,
) -> int:
    """Write the control software and the virtual robot as a C library: header, object, shared
    library, example.

    Each is one `step` a millisecond on plain structs, without allocation, with the bits of
    `rj.ControlSoftware` and `rj.VirtualRobot`. The shared library takes a C compiler to link; the
    object does not.

    Parameters
    ----------
    folder
        Where to write; files of an earlier export there are replaced.
    """
    from ravenjax.analyses.export import c_folder
    from ravenjax.errors import UserError
    from ravenjax.robots.raven2.hardware.virtual_robot import VirtualRobot
    from ravenjax.robots.raven2.software.control_software import ControlSoftware

    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder} is a file, expected a folder to write into")
    software = ControlSoftware(
        arms=arms or ("gold", "green"), tools=tools, policy=policy, level=level
    )  # type: ignore[arg-type]
    robot = VirtualRobot(software.setup.arms, software.setup.tools, parameter_set)
    written = c_folder.write(folder, software, robot, cpu)
    if as_json:
        console.emit_json(
            {name: None if path is None else str(path) for name, path in written._asdict().items()}
        )
        return 0
    for path in written:
        if path is not None:
            console.say(str(path))
    if written.shared is None:
        console.note(
            f"no C compiler ({', '.join(c_folder.COMPILERS)}) to link a shared library with: link"
            f" {written.object} and the C library's mathematics (-lm) into your program"
        )
    return 0

"""The command `export`: writes control software and virtual robot as a C library."""

from pathlib import Path
from typing import Literal

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Words


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

    Header, object, shared library and example. Each part is one `step` per millisecond on plain
    structs, without memory allocation, with the bits of `rj.ControlSoftware` and
    `rj.VirtualRobot`. Only the shared library needs a C compiler.

    Parameters
    ----------
    folder
        Where to write; files of an earlier export there are replaced.
    arms
        gold, green or both
    tools
        one an arm
    policy
        no_regulation, soft_regulation or hard_regulation
    level
        overdrive level: beginner, moderate, advanced
    parameter_set
        mechanics of the virtual robot
    cpu
        portable: any CPU of this kind; native: this one; the same bits
    """
    from ravenjax.analyses.export import c_folder
    from ravenjax.errors import UserError
    from ravenjax.robots.raven2.hardware.virtual_robot import VirtualRobot
    from ravenjax.robots.raven2.software.control_software import ControlSoftware

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
    for path in written:
        if path is not None:
            console.print_text(str(path))
    if written.shared is None:
        console.print_note(
            f"no C compiler ({', '.join(c_folder.COMPILERS)}) to link a shared library with: link"
            f" {written.object} and the C library's mathematics (-lm) into your program"
        )
    return None

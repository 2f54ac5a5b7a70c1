"""Commands that use the folder `analysis` of a checkout, and `ravenjax doctor`.

`bench` measures the speed of this machine. `reproduce` runs studies, and `credibility` prints the
evidence for each of their claims. `evidence` writes tables and a safety argument for a risk
management file. `doctor` checks the installation.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Engine, Listing, Switch, load_module

TableName = Literal["engines", "shell", "cores", "devices", "peers"]


def bench(
    *,
    json: Switch = False,
    quick: Switch = False,
    markdown: Path | None = None,
    only: Annotated[list[TableName] | None, Parameter(consume_multiple=True, negative="")] = None,
    seconds: float | None = None,
    price: float | None = None,
) -> int:
    """Measure the speed of this machine, and compare it with MuJoCo and MJX.

    Each measurement runs in its own process. Measurements for which the time is too short are
    left out, and the output names them. The exit code is 1 if nothing could be measured.

    Args:
        json: print every number as JSON
        quick: only the short measurements: half a minute instead of minutes
        markdown: also write the tables to this file
        only: only these measurements
        seconds: approximate limit of the total time, s; default: 160, or 35 with --quick
        price: price of this machine in dollars an hour; adds the cost of a million runs of 10 s in
            cents
    """
    suite = load_module("bench.suite")
    return suite.bench(json, quick, markdown, only or (), seconds, price)


def reproduce(
    name: str | None = None,
    *,
    out: Path = Path("results/reproduce"),
    engine: Engine = "auto",
    keep: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Repeat a published experiment, or run a study, and compare the results with the publication.

    Args:
        name: Name of the study, or "all". Default: list all studies.
        out: folder for the results; each study gets its own folder in it
        keep: also copy the findings, without pictures, into this folder
    """
    load_module("studies.commands").reproduce(name, out, engine, keep, as_json)


def credibility(folder: Path = Path("results/reproduce"), *, out: Path | None = None) -> None:
    """Print the evidence for each claim of the studies, in the order of FDA's guidance of 2023.

    Args:
        folder: Folder with findings of `ravenjax reproduce`, from its option --out or --keep.
        out: file to write; default: print the evidence
    """
    load_module("studies.commands").credibility(folder, out)


def evidence(
    *folders: Path,
    out: Path | None = None,
    check: Path | None = None,
    xlsx: Switch = False,
    credibility: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Write evidence for a risk file: failure modes, hazards, unsafe control actions, an argument.

    Every number refers to runs, and every file has a checksum. The evidence claims no conformity
    with any standard. With --check the exit code is 1 if a statement is no longer true; the
    argument shows such statements in red.

    Args:
        folders: One or several result folders that `ravenjax run` wrote.
        out: folder to write into; default FOLDER/evidence of a single result folder
        check: compute the checksums of the evidence in this folder again, and write nothing new
        xlsx: also write the tables as one workbook (extra: xlsx)
        credibility: folder with findings of `ravenjax reproduce`; adds the evidence for the
            simulator's credibility
    """
    commands = load_module("evidence.commands")
    return commands.evidence(folders, out, check, xlsx, credibility, as_json)


def doctor(*, realtime: Switch = False, seconds: float = 60.0, as_json: AsJson = False) -> int:
    """Check this installation: versions, devices, CPU, memory, and a test of each part.

    Args:
        realtime: instead, measure how punctually this machine computes one tick per millisecond
        seconds: duration of each of the two measurements of --realtime, s
    """
    from ravenjax.cli import terminal

    if realtime:
        return _measure_realtime(seconds, as_json)
    properties = list(terminal.describe_machine())
    machine_table = Listing("machine", "This machine", ("property", "value"), properties)
    # The tests take seconds, so the first table is printed before they start.
    if not as_json:
        console.print_tables([machine_table], as_json)
        console.out.print()
    tests: dict[str, Callable[[], str]] = {
        "jax computes": _test_jax,
        "engine auto": _choose_engine,
        "robot model": _load_robot_model,
        "campaigns": _load_bundled_campaigns,
        "results": _create_file,
        "console port": _open_console_port,
    }
    results = list(terminal.run_checks(tests))
    test_table = Listing("works", "What works", ("test", "state", "detail"), results)
    console.print_tables([machine_table, test_table] if as_json else [test_table], as_json)
    return int(any(state != "ok" for _, state, _ in results))


def _measure_realtime(seconds: float, as_json: bool) -> int:
    # Prints how punctually this machine computes ticks of 1 ms. Returns 1 if it is too slow.
    from ravenjax.cli import timing

    measured = timing.measure_timing(seconds, lambda text: console.print_text(text, console.err))
    rows = [timing.timing_row(loop, loop_timing) for loop, loop_timing in measured.items()]
    loop_table = Listing("loops", "Timing of one tick per millisecond", timing.COLUMNS, rows)
    requirements = timing.timing_verdict(measured)
    verdict_table = Listing("verdict", "", ("state", "sentence"), requirements)
    console.print_tables([loop_table, verdict_table], as_json)
    return int(any(state != "ok" for state, _ in requirements))


def _test_jax() -> str:
    # Runs a small JAX program. Returns the devices on which JAX can compute.
    import jax
    import jax.numpy as jnp

    total = float(jax.jit(lambda x: (x * x).sum())(jnp.arange(4.0)))
    if total != 14.0:
        raise ArithmeticError(f"JAX computed 0 + 1 + 4 + 9 = {total}, expected 14")
    return ", ".join(
        f"{device.platform}:{device.id} {device.device_kind}" for device in jax.devices()
    )


def _choose_engine() -> str:
    # Returns the engine that campaigns use on this machine, and why they use no faster engine.
    from ravenjax.engines import selection

    name, reason = selection.fastest_engine(None)
    device = selection.select_engine(name).device
    return f"{name} on {device}" + (f"; {reason}" if reason else "")


def _load_robot_model() -> str:
    # Loads the MuJoCo model of the Raven-II. Returns its path and number of joints.
    import mujoco

    from ravenjax import resources

    path = resources.find_model("raven2/raven2.xml")
    model = mujoco.MjModel.from_xml_path(str(path))  # pyright: ignore[reportAttributeAccessIssue]
    return f"{path}, {model.njnt} joints"


def _load_bundled_campaigns() -> str:
    # Loads each bundled campaign file, which raises an error for an invalid file.
    from ravenjax import resources
    from ravenjax.campaign import loading

    files = resources.list_resources("campaigns", "*.toml")
    for path in files:
        loading.load_campaign(path)
    return f"{len(files)} bundled campaigns are valid"


def _create_file() -> str:
    # Creates and deletes a folder in the current folder, in which commands write results.
    import tempfile

    with tempfile.TemporaryDirectory(dir=Path.cwd()):
        return f"files can be created in {Path.cwd()}"


def _open_console_port() -> str:
    # Opens and closes the UDP port for console packets, which fails if a program uses the port.
    import socket

    from ravenjax.robots.raven2.console.packet import UDP_PORT

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", UDP_PORT))
    return f"127.0.0.1:{UDP_PORT} is free"

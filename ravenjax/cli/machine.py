"""Commands that use the folder `analysis` of a checkout, and `ravenjax doctor`.

`bench` measures the speed of this machine. `reproduce` runs studies, and `credibility` prints the
evidence for each of their claims. `evidence` writes tables and an argument for a risk file.
`doctor` checks the installation.
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
    rows = list(terminal.describe_machine())
    about = Listing("machine", "This machine", ("property", "value"), rows)
    if not as_json:
        console.print_tables([about], as_json)
        console.out.print()
    tests: dict[str, Callable[[], str]] = {
        "jax computes": _jax_computes,
        "engine auto": _engine_chosen,
        "robot model": _model_loads,
        "campaigns": _campaigns_load,
        "results": _results_writable,
        "console port": _port_opens,
    }
    states = list(terminal.run_checks(tests))
    works = Listing("works", "What works", ("test", "state", "detail"), states)
    console.print_tables([about, works] if as_json else [works], as_json)
    return int(any(state != "ok" for _, state, _ in works.rows))


def _measure_realtime(seconds: float, as_json: bool) -> int:
    # Prints how punctual ticks of 1 ms are on this machine. Returns the exit status.
    from ravenjax.cli import timing

    measured = timing.measure_timing(seconds, lambda what: console.print_text(what, console.err))
    rows = [timing.timing_row(*loop) for loop in measured.items()]
    loops = Listing("loops", "Timing of one tick per millisecond", timing.COLUMNS, rows)
    states = timing.timing_verdict(measured)
    verdict = Listing("verdict", "", ("state", "sentence"), list(states))
    console.print_tables([loops, verdict], as_json)
    return int(any(state != "ok" for state, _ in states))


def _jax_computes() -> str:
    # Runs a small JAX program; returns the devices.
    import jax
    import jax.numpy as jnp

    total = float(jax.jit(lambda x: (x * x).sum())(jnp.arange(4.0)))
    if total != 14.0:
        raise ArithmeticError(f"JAX computed 0 + 1 + 4 + 9 = {total}, expected 14")
    return ", ".join(f"{one.platform}:{one.id} {one.device_kind}" for one in jax.devices())


def _engine_chosen() -> str:
    # Returns the engine for campaigns on this machine, and why no faster engine is used.
    from ravenjax.engines import selection
    from ravenjax.numbers.setup import CAMPAIGN

    name, why = selection.fastest_engine(CAMPAIGN)
    device = selection.select_engine(name, CAMPAIGN).device
    return f"{name} on {device}" + (f"; {why}" if why else "")


def _model_loads() -> str:
    # Loads the MuJoCo model of the Raven-II.
    import mujoco

    from ravenjax.bundled import resources

    path = resources.find_model("raven2/raven2.xml")
    model = mujoco.MjModel.from_xml_path(str(path))  # pyright: ignore[reportAttributeAccessIssue]
    return f"{path}, {model.njnt} joints"


def _campaigns_load() -> str:
    # Checks all bundled campaign files.
    from ravenjax.bundled import resources
    from ravenjax.campaign import loading

    files = resources.list_resources("campaigns", "*.toml")
    for path in files:
        loading.load_campaign(path)
    return f"{len(files)} bundled campaigns are valid"


def _results_writable() -> str:
    import tempfile

    with tempfile.TemporaryDirectory(dir=Path.cwd()):
        return f"files can be created in {Path.cwd()}"


def _port_opens() -> str:
    # Checks that the UDP port for console packets can be opened.
    import socket

    from ravenjax.robots.raven2.console.packet import UDP_PORT

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", UDP_PORT))
    return f"127.0.0.1:{UDP_PORT} is free"

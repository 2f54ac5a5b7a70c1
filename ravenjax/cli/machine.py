"""Commands whose code is in the folder `analysis` of a checkout, and `doctor`.

`bench` measures this machine, `reproduce` runs studies, `credibility` prints the evidence for each
of their claims, and `evidence` writes tables and an argument for a risk file.
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

    Each part runs in its own process. Parts that do not fit into the time are named and left
    out. The exit code is 1 if nothing could be measured.

    Parameters
    ----------
    json
        print every number as JSON
    quick
        half a minute instead of minutes: the shorter parts
    markdown
        also write the tables to this file
    only
        these parts alone
    seconds
        how long it may take, about; default: 160, and 35 of a quick run
    price
        dollars that this machine costs an hour: adds cents per million runs of 10 s
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
    """Repeat a published experiment, or run a study, and compare prediction and publication.

    Parameters
    ----------
    name
        The study, or "all". Without one: list them.
    out
        folder for the results; each study gets its own folder in it
    keep
        also copy the findings, without pictures, into this folder
    """
    load_module("studies.commands").reproduce(name, out, engine, keep, as_json)


def credibility(folder: Path = Path("results/reproduce"), *, out: Path | None = None) -> None:
    """Print the evidence for each claim of the studies, in the order of FDA's guidance of 2023.

    Parameters
    ----------
    folder
        Findings of `ravenjax reproduce`: its folder --out, or --keep.
    out
        write it to this file; default: print it
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

    Every number leads to runs, and every file has a checksum. It claims no conformity with any
    standard. With --check the exit code is 1 if something no longer holds; the argument shows
    it in red.

    Parameters
    ----------
    folders
        What `ravenjax run` wrote, one folder or several.
    out
        folder to write into; default FOLDER/evidence of a single one
    check
        compute the checksums of evidence in this folder again, and write nothing new
    xlsx
        the tables as one workbook, too (extra: xlsx)
    credibility
        findings of `ravenjax reproduce`: report what the simulator's credibility rests on, too
    """
    commands = load_module("evidence.commands")
    return commands.evidence(folders, out, check, xlsx, credibility, as_json)


def doctor(*, realtime: Switch = False, seconds: float = 60.0, as_json: AsJson = False) -> int:
    """Check this machine: versions, devices, CPU, memory, and that each part works.

    Parameters
    ----------
    realtime
        measure how well a session keeps time instead
    seconds
        of each of the two loops that --realtime measures
    """
    from ravenjax.cli import terminal

    if realtime:
        return _keeps_time(seconds, as_json)
    about = Listing("machine", "This machine", ("what", "is"), list(terminal.describe_machine()))
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
    works = Listing(
        "works", "What works", ("what", "state", "detail"), list(terminal.run_checks(tests))
    )
    console.print_tables([about, works] if as_json else [works], as_json)
    return int(any(state != "ok" for _, state, _ in works.rows))


def _keeps_time(seconds: float, as_json: bool) -> int:
    from ravenjax.train import timing

    measured = timing.measure_timing(seconds, lambda what: console.print_text(what, console.err))
    rows = [timing.timing_row(*loop) for loop in measured.items()]
    loops = Listing("loops", "One tick a millisecond", timing.COLUMNS, rows)
    states = timing.timing_verdict(measured)
    verdict = Listing("verdict", "", ("state", "sentence"), list(states))
    console.print_tables([loops, verdict], as_json)
    return int(any(state != "ok" for state, _ in states))


def _jax_computes() -> str:
    import jax
    import jax.numpy as jnp

    total = float(jax.jit(lambda x: (x * x).sum())(jnp.arange(4.0)))
    if total != 14.0:
        raise ArithmeticError(f"0 + 1 + 4 + 9 came out as {total}")
    return ", ".join(
        f"{device.platform}:{device.id} {device.device_kind}" for device in jax.devices()
    )


def _engine_chosen() -> str:
    from ravenjax.engines import selection
    from ravenjax.numbers.setup import CAMPAIGN

    name, why = selection.fastest_engine(CAMPAIGN)
    return f"{name} on {selection.select_engine(name, CAMPAIGN).device}" + (
        f"; {why}" if why else ""
    )


def _model_loads() -> str:
    import mujoco

    from ravenjax.bundled import resources

    path = resources.find_model("raven2/raven2.xml")
    model = mujoco.MjModel.from_xml_path(str(path))  # pyright: ignore[reportAttributeAccessIssue]
    return f"{path}, {model.njnt} joints"


def _campaigns_load() -> str:
    from ravenjax.bundled import resources
    from ravenjax.campaign import loading

    files = resources.list_resources("campaigns", "*.toml")
    for path in files:
        loading.load_campaign(path)
    return f"{len(files)} bundled campaigns are valid"


def _results_writable() -> str:
    import tempfile

    with tempfile.TemporaryDirectory(dir=Path.cwd()):
        return f"{Path.cwd()} can be written to"


def _port_opens() -> str:
    import socket

    from ravenjax.robots.raven2.console.packet import UDP_PORT

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", UDP_PORT))
    return f"127.0.0.1:{UDP_PORT} is free"

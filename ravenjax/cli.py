"""The command line: parses, joins the parts below, prints. Everything slow is imported inside the commands."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter
from rich.console import Console

USER_ERROR, INTERRUPTED = 2, 130
"""Exit codes: bad input, and Ctrl-C."""

app = App(
    name="ravenjax",
    help="A virtual Raven-II surgical robot: faults, built-in checks, haptics, thousands of runs in parallel.",
    version=lambda: _version(),
    suppress_keyboard_interrupt=False,
)
_out = Console()
_err = Console(stderr=True)

Overrides = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        consume_multiple=True,
        negative="",
        help="key.path=value, as campaign.duration_s=5 or group.0.runs=100",
    ),
]


@app.command
def run(
    file: str,
    *,
    out: Annotated[Path | None, Parameter(help="result folder; default results/NAME of the campaign")] = None,
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    overrides: Overrides = None,
    chunk: Annotated[int | None, Parameter(help="runs per part of the result")] = None,
    limit: Annotated[int | None, Parameter(help="compute only the first runs")] = None,
    report: Annotated[bool, Parameter(help="write report.html at the end")] = True,
) -> None:
    """Run a campaign, or finish it where OUT holds a part of it.

    Parameters
    ----------
    file
        Campaign file, or the name of a bundled one (see `ravenjax campaigns`).
    """
    from ravenjax import terminal
    from ravenjax.campaign import loading

    sizes = {"chunk": chunk, "limit": limit}
    given = [*(overrides or ()), *(f"campaign.{key}={value}" for key, value in sizes.items() if value is not None)]
    config = loading.load(file, given)
    folder = out or Path("results") / config.campaign.name

    from ravenjax.campaign import runner

    with terminal.Watch(_out) as watch:
        results = runner.run_campaign(config, folder, engine, on_progress=watch)
    rows = terminal.outcome_rows(results.verdicts())
    if rows:
        _out.print(terminal.table("Faulty runs", ("response / haptic / jump", "runs", "share, 95 % interval"), rows))
    _out.print(f"results: {folder}", highlight=False, soft_wrap=True)
    if report:
        _report(folder)


@app.command(name="report")
def report_(
    folder: Path,
    *,
    figures: Annotated[Path | None, Parameter(help="also draw the main figures into this folder, SVG and PDF")] = None,
) -> None:
    """Write report.html into a result folder.

    Parameters
    ----------
    folder
        What `ravenjax run` wrote.
    """
    _report(folder)
    if figures is not None:
        from ravenjax.report import paper

        for path in paper.write(folder, figures):
            _out.print(f"wrote {path}", highlight=False, soft_wrap=True)


@app.command
def trace(
    folder: Path,
    run_id: str,
    *,
    out: Annotated[Path | None, Parameter(help="folder of the trace; default FOLDER/traces")] = None,
    engine: Annotated[str, Parameter(help="auto is the engine that the campaign ran on")] = "auto",
) -> None:
    """Run one row of a result again and write its whole time series: MCAP and a plot.

    Parameters
    ----------
    folder
        What `ravenjax run` wrote.
    run_id
        The row's run_id, or enough of its beginning to tell it from others, or its index.
    """
    from ravenjax.campaign import replay
    from ravenjax.report import wording
    from ravenjax.report.trace_plot import trace_plot
    from ravenjax.store import files, manifest, trace_log

    record = manifest.read(folder)
    place = out or folder / "traces"
    files.require_writable(place)
    if record.code_hash != manifest.code_hash():
        _err.print(f"note: {folder} was computed by another version of the code; the run may come out otherwise")
    again = replay.from_folder(folder, run_id, engine)
    row, series = again.row, again.series
    log, plot = place / f"{row['run_id']}.mcap", place / f"{row['run_id']}.svg"
    columns = ("run_id", "index", "group", "seed", "verdict", "response_cause")
    trace_log.write(log, series, {name: str(row[name]) for name in columns})
    cue, cues = record.verdict_cue, record.cues
    named = {"fault": "first_active_ms", "cue": f"cue{cue}_first_ms", str(row["response"]): "response_ms"}
    trace_plot(
        _plotted(series, cue),
        plot,
        title=f"run {row['run_id']} · {row['verdict'] or row['failed']}",
        subtitle=f"{row['group']}: {wording.fault(row.to_dict())}",
        threshold_mm=cues[cue].threshold_mm if cues else 3.0,
        events={name: float(row.at[column]) for name, column in named.items()},
    )
    for path in (log, plot):
        _out.print(f"wrote {path}", highlight=False, soft_wrap=True)


@app.command
def search(
    file: str,
    *,
    out: Annotated[Path | None, Parameter(help="folder; default results/NAME of the search")] = None,
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    overrides: Overrides = None,
) -> None:
    """Find what matters: the smallest harmful fault, the parameters that decide, how rare an outcome is.

    Parameters
    ----------
    file
        Search file, or the name of a bundled one (see `ravenjax campaigns`).
    """
    from ravenjax import terminal
    from ravenjax.search import runner

    with terminal.Watch(_out) as watch:
        found = runner.run(file, out, engine, overrides or (), watch)
    for sentence in found.findings.sentences:
        _out.print(f"- {sentence}", markup=False, highlight=False)
    _out.print(f"search: {found.out}", highlight=False, soft_wrap=True)


@app.command
def reproduce(
    name: str | None = None,
    *,
    out: Annotated[Path, Parameter(help="folder; each study has one inside")] = Path("results/reproduce"),
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    keep: Annotated[Path | None, Parameter(help="also copy the findings, without pictures, into this folder")] = None,
) -> None:
    """Run a published experiment, or a study of our own, and set what is predicted beside what was published.

    Parameters
    ----------
    name
        The study, or "all". Without one: list them.
    """
    from ravenjax import terminal
    from ravenjax.studies import catalogue, markdown, running, writing

    if name is None:
        rows = [
            (one.name, one.title, ", ".join(one.targets), f"{one.minutes:g}")
            for one in map(catalogue.find, catalogue.NAMES)
        ]
        _out.print(terminal.table("Studies: ravenjax reproduce NAME", ("name", "what", "targets", "minutes"), rows))
        return
    for study in catalogue.NAMES if name == "all" else (catalogue.find(name).name,):
        with terminal.Watch(_out) as watch:
            findings = running.reproduce(study, out, engine, watch)
        if findings.lines:
            title = catalogue.find(study).title
            _out.print(terminal.table(title, markdown.BRIEF_COLUMNS, markdown.line_rows(findings)))
        _out.print(f"findings: {out / study / writing.PAGE}", highlight=False, soft_wrap=True)
        if keep is not None:
            writing.keep(out / study, keep / study)


@app.command
def campaigns() -> None:
    """List the bundled campaigns."""
    from ravenjax import resources, terminal
    from ravenjax.campaign import design, loading

    rows = []
    for path in resources.bundled("campaigns", "*.toml"):
        config = loading.load(path)
        rows.append((path.name, str(design.count(config)), config.campaign.description))
    _out.print(terminal.table("Campaigns: ravenjax run FILE", ("file", "runs", "what it asks"), rows))
    from ravenjax.search import loading as searches

    found = [(path.name, searches.load(path)) for path in resources.bundled("campaigns/searches", "*.toml")]
    rows = [(name, one.search.kind, one.campaign.campaign.description) for name, one in found]
    _out.print()
    _out.print(terminal.table("Searches: ravenjax search FILE", ("file", "kind", "what it asks"), rows))


@app.command
def faults(hazard: str | None = None) -> None:
    """List the fault sites with their channels, the effects, the triggers and the library of hazards.

    Parameters
    ----------
    hazard
        Id of a hazard of the library: show all that is known of it instead.
    """
    from ravenjax import terminal
    from ravenjax.hazards import listing

    if hazard is not None:
        _out.print(terminal.table(f"Hazard {hazard}", ("what", "is"), listing.description(hazard)))
        return
    from ravenjax.robot.sites import SITES
    from ravenjax.stages.faults.vocabulary import EFFECTS, TRIGGERS

    sites = []
    for site in SITES.values():
        kinds: dict[str, list[str]] = {}
        for channel in site.channels:
            kinds.setdefault(f"{channel.kind} {channel.unit}", []).append(channel.name)
        channels = "; ".join(f"{' '.join(names)} ({kind})" for kind, names in kinds.items())
        sites.append((site.layer, site.name, ("each arm: " if site.per_arm else "") + channels, site.where))
    columns = ("layer", "site", "channels (number, unit)", "where")
    _out.print(terminal.table("Sites, in the robot's order", columns, sites))
    _out.print()
    _out.print(terminal.table("Effects", ("effect", "meaning"), list(EFFECTS.items())))
    _out.print()
    _out.print(terminal.table("Triggers", ("trigger", "start_ms counts"), list(TRIGGERS.items())))
    _out.print()
    _out.print(terminal.table("Hazards; `ravenjax faults ID` shows one", listing.COLUMNS, listing.table()))


@app.command
def parameters(file: str | None = None, *, overrides: Overrides = None) -> None:
    """List the parameters that a campaign may vary, with the values that they have without it and their ranges.

    Parameters
    ----------
    file
        Campaign file; its software, arms and tools decide what there is. Without one: one arm, software raven2.
    """
    from ravenjax import paths, terminal
    from ravenjax.campaign import bounds, loading, plan

    plain = {"campaign": {"name": "plain"}, "group": [{"name": "plain"}]}
    given = overrides or ()
    config = loading.load(file, given) if file is not None else loading.from_dict(plain, overrides=given)
    program = plan.make(config.model_copy(update={"parameters": {}})).program
    values: dict[str, list[str]] = {}
    for path, value in paths.leaves(program.params, program.setup.arms):
        head, _, last = path.rpartition(".")
        key = head if last in paths.COMPONENTS else path
        values.setdefault(key, []).append(f"{float(value):g}")
    ranges = {path: bounds.of(path) for path in values}  # none: not a campaign's to vary
    rows = [
        (path, " ".join(values[path]), "; ".join(row.range for row in rows)) for path, rows in ranges.items() if rows
    ]
    _out.print(terminal.table("Parameters", ("path", "value", "may be"), rows))


@app.command
def bench(
    *,
    json: Annotated[bool, Parameter(negative="", help="print every number as JSON")] = False,
    quick: Annotated[bool, Parameter(negative="", help="half a minute instead of minutes")] = False,
    markdown: Annotated[Path | None, Parameter(help="also write the tables to this file")] = None,
) -> None:
    """Measure this machine: full ticks a second of each engine, beside MJX and mujoco.rollout on the same arm."""
    import json as json_format

    from ravenjax import terminal
    from ravenjax.bench import suite, tables
    from ravenjax.errors import UserError

    if markdown is not None and not markdown.absolute().parent.is_dir():
        raise UserError(f"--markdown {markdown}: the folder does not exist, expected a file in a folder that does")
    effort = suite.QUICK if quick else suite.FULL
    found = suite.measure(effort, lambda what: _err.print(f"measuring: {what}", highlight=False))
    if markdown is not None:
        markdown.write_text(tables.markdown(found, f"ravenjax bench{' --quick' if quick else ''} --markdown FILE"))
    if json:
        print(json_format.dumps(found.as_json(), indent=1))
        return
    for title, columns, rows in tables.tables(found):
        _out.print(terminal.table(title, columns, rows))
        _out.print()


@app.command
def doctor() -> int:
    """Check this machine: versions, devices, CPU, memory, and that each part works."""
    from ravenjax import terminal
    from ravenjax.robot.packet import UDP_PORT

    _out.print(terminal.table("This machine", ("what", "is"), list(terminal.machine())))
    _out.print()
    tests: dict[str, Callable[[], str]] = {
        "jax computes": _jax_computes,
        "engine auto": _engine_chosen,
        "robot model": _model_loads,
        "campaigns": _campaigns_load,
        "results": _results_writable,
        "console port": lambda: terminal.udp_port(UDP_PORT),
    }
    found = list(terminal.checks(tests))
    _out.print(terminal.table("What works", ("what", "state", "detail"), found))
    return int(any(state != "ok" for _, state, _ in found))


def _plotted(series: dict[str, Any], cue: int) -> dict[str, Any]:
    """A replay's series under the names that the plot knows, with the force of that cue."""
    active = [values for name, values in series.items() if name.startswith("fault") and name.endswith("_active")]
    commands = {name.replace("dac_cnt", "current_cmd"): values for name, values in series.items() if "dac_cnt" in name}
    forces = {n.replace("cue_force", "haptic_force"): v[:, cue] for n, v in series.items() if n.endswith("/cue_force")}
    return {
        **series,
        **commands,
        **forces,
        "pedal": series["surgeon_mode"],
        **({"fault_active": sum(active) > 0} if active else {}),
    }


def _report(folder: Path) -> None:
    from ravenjax.report import page

    _out.print(f"report: {page.build(folder)}", highlight=False, soft_wrap=True)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("ravenjax")
    except PackageNotFoundError:
        return "unknown (not installed as a package)"


def _jax_computes() -> str:
    import jax
    import jax.numpy as jnp

    total = float(jax.jit(lambda x: (x * x).sum())(jnp.arange(4.0)))
    if total != 14.0:
        raise ArithmeticError(f"0 + 1 + 4 + 9 came out as {total}")
    return ", ".join(f"{device.platform}:{device.id} {device.device_kind}" for device in jax.devices())


def _engine_chosen() -> str:
    from ravenjax.engines import selection
    from ravenjax.types import CAMPAIGN

    name, why = selection.fastest(CAMPAIGN)
    return f"{name} on {selection.select(name, CAMPAIGN).device}" + (f"; {why}" if why else "")


def _model_loads() -> str:
    import mujoco

    from ravenjax import resources

    path = resources.model("raven2/raven2.xml")
    model = mujoco.MjModel.from_xml_path(str(path))  # pyright: ignore[reportAttributeAccessIssue]
    return f"{path}, {model.njnt} joints"


def _campaigns_load() -> str:
    from ravenjax import resources
    from ravenjax.campaign import loading

    files = resources.bundled("campaigns", "*.toml")
    for path in files:
        loading.load(path)
    return f"{len(files)} bundled campaigns are valid"


def _results_writable() -> str:
    import tempfile

    with tempfile.TemporaryDirectory(dir=Path.cwd()):
        return f"{Path.cwd()} can be written to"


def main(tokens: list[str] | None = None) -> int:
    """Run the command line; what a user can mend becomes one message and exit code 2."""
    from ravenjax.errors import UserError

    try:
        code = app(tokens, exit_on_error=False, print_error=True, result_action="return_value")
    except KeyboardInterrupt:
        _err.print("stopped; finished parts are kept, and the same command goes on from there", highlight=False)
        return INTERRUPTED
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else 1
    except Exception as error:
        if isinstance(error, UserError) or _is_mendable(error):
            if not _is_parse_error(error):
                _err.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
            return USER_ERROR
        raise
    return code if isinstance(code, int) else 0


def _is_parse_error(error: Exception) -> bool:
    """Whether the command line itself was wrong; that has been printed already."""
    from cyclopts import CycloptsError

    return isinstance(error, CycloptsError)


def _is_mendable(error: Exception) -> bool:
    if _is_parse_error(error):
        return True
    from ravenjax.store.files import StoreError

    return isinstance(error, StoreError)


if __name__ == "__main__":
    sys.exit(main())

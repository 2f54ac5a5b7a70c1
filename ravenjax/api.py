"""Functions with which a notebook or a Python program loads, runs and inspects campaigns."""

# Callers may pass anything, and pandas has no types.
# pyright: reportUnnecessaryIsInstance=false, reportMissingTypeStubs=false

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection.replay import Replayer
from ravenjax.campaign.loading import load_campaign, load_source, result_folder
from ravenjax.campaign.progress import OnProgress
from ravenjax.notebook.campaign import Campaign, run_config
from ravenjax.notebook.results import CampaignResults, column_meanings
from ravenjax.report import downloads, wording
from ravenjax.store import manifest
from ravenjax.store.logs import time_series

if TYPE_CHECKING:
    import xarray


AnyCampaign = Campaign | CampaignConfig | str | Path | dict[str, Any]
"""A campaign as an object, as nested tables, as the path of a file, or as a bundled name."""


def run(
    campaign: AnyCampaign,
    out: str | Path | None = None,
    engine: str = "auto",
    on_progress: OnProgress | None = None,
    executor: str | None = None,
    workers: int | None = None,
) -> pd.DataFrame:
    """Run a campaign and return a table with one row per run.

    docs/reference/columns.md describes the columns; the table's `attrs` contain their units and
    meanings. campaign: an object, nested tables as in a TOML file, the path of a file, or the name
    of a bundled campaign. out: result folder; an interrupted campaign in it is continued. None: a
    temporary folder. executor: "local" (this process) or "ray". workers: number of parallel tasks,
    which does not change the table. Raise UserError, and StoreError for errors of `out`.
    """
    results = run_config(_config(campaign), out, engine, on_progress, executor, workers)
    table = results.frame()
    table.attrs.update(column_meanings(results.shape))
    return table


def open_results(folder: str | Path) -> CampaignResults:
    """Open a result folder that `run` or the command line wrote. Raise UserError and StoreError."""
    return CampaignResults(folder)


def simulate(campaign: AnyCampaign, run: str | int = 0, engine: str = "auto") -> xarray.Dataset:
    """Return the time series of one run of a campaign as an xarray.Dataset, one tick per ms.

    Each quantity is a variable with attrs units and long_name. Coordinates are time (s), arm,
    joint, axis, fault and cue: `simulate(c, 42)["tip"].sel(arm="gold", axis="z")`. The dataset has
    the attrs index, id and outcomes of the run. run: index or first letters of the run id. Raise
    UserError for a wrong campaign or run.
    """
    config = _config(campaign)
    replay = Replayer(config, engine).replay(run)
    row: dict[str, Any] = {str(name): value for name, value in replay.row.items()}
    columns = ("run_id", "group", "operator", "verdict", "response", "response_cause", "hazard")
    attributes = {column: str(row[column]) for column in columns} | {
        "index": int(row["index"]),
        "seed": int(row["seed"]),
        "fault": wording.describe_fault(row, config.robot),
        "campaign": config.campaign.name,
        "engine": replay.engine,
        "version": manifest.package_versions()["ravenjax"],
    }
    thresholds_mm = [cue.threshold_m * 1e3 for cue in config.haptics.cues()]
    return time_series.series_dataset(replay.series, attributes, thresholds_mm, config.robot)


def explain(
    campaign: AnyCampaign | CampaignResults,
    runs: int | str | Sequence[int | str] | None = None,
    engine: str = "auto",
) -> pd.DataFrame:
    """Return how errors propagate from faults through the robot's signals.

    The table has a row for each run and each signal that differs from the golden run, in the
    robot's order of signals. Columns: run_id, index, layer, arm, seam (name of the signal).
    differs_ms: time of the first difference, in element differs_in of the signal. leaves_ms: time
    at which element leaves_in of the signal first leaves its normal range (-1: never). harm_ms:
    start of the run's hazard (-1: no hazard). left_ms: harm_ms minus leaves_ms (NaN if either is
    missing). The attrs of the table name the engine.

    campaign: a campaign as for `run`, or a result folder. runs: an index, a run id or its first
    letters, or a list of these; None: every run with a fault. Raise UserError and StoreError.
    """
    from ravenjax.notebook import explaining

    folder = _folder(campaign)
    return explaining.explain_table(folder or _config(campaign), runs, engine)


def counterfactual(
    campaign: AnyCampaign | CampaignResults,
    out: str | Path | None = None,
    *,
    false_alarms_per_hour: float = 4.0,
    lead_ms: int = 10,
    hours: float = 2.0,
    most: int = 8,
    groups: Sequence[str] = (),
    seed: int = 0,
    engine: str = "auto",
) -> pd.DataFrame:
    """Select a few additional checks that detect the faults which evade the robot's checks.

    Return the table `counterfactual.csv`, with a row per candidate check. The column `chosen` marks
    the selected checks. attrs: "sentences" (the findings) and "files" (the written files).
    campaign: see `run`, or a result folder. out: folder for the table, a figure, and a campaign
    with the selected checks as detectors; None writes nothing. Other arguments: see `ravenjax
    counterfactual --help`. Raise UserError and StoreError.
    """
    from ravenjax.analyses.monitors.counterfactual import finding, output
    from ravenjax.analyses.monitors.counterfactual.candidates import Question

    question = Question(false_alarms_per_hour, lead_ms, hours, most, tuple(groups), seed)
    folder = _folder(campaign)
    config = load_source(folder) if folder else _config(campaign)
    found = finding.find_checks(config, question, engine)
    files = [] if out is None else output.write_files(found, Path(out))
    # The table is read from CSV, so that it has the types of the written file.
    text = io.StringIO(downloads.format_csv(output.candidate_table(found)))
    table = pd.read_csv(text, keep_default_na=False, na_values=[""])
    table.attrs["sentences"] = output.finding_sentences(found)
    table.attrs["files"] = [str(path) for path in files]
    return table


def calibrate_monitor(
    campaign: AnyCampaign,
    out: str | Path,
    signals: Sequence[str] = (),
    false_alarms_per_hour: float = 1.0,
    confidence: float = 0.95,
    hours: float | None = None,
    length_s: float = 300.0,
    robots: int = 16,
    segments: str = "",
    motions: Sequence[str] = (),
    seed: int = 0,
    engine: str = "auto",
) -> dict[str, Any]:
    """Calibrate a monitor: find thresholds whose false-alarm rate is at most the given rate, with
    the given confidence (`ravenjax monitor calibrate`).

    Write monitor.toml, monitor.py, C code and a test vector into `out`. Return the tables of
    monitor.toml. hours: total fault-free operation to simulate; None: as much as rate and
    confidence require. Repeat an interrupted call to continue it. Raise UserError and StoreError.
    """
    from ravenjax.analyses.monitors import calibrate, writing

    rate, config = false_alarms_per_hour, _config(campaign)
    request = calibrate.Request(
        config, signals, segments, rate, confidence, length_s, robots, motions, seed
    )
    calibrate.calibrate_monitor(request, Path(out), hours, engine)
    _, tables = writing.read_monitor(Path(out))
    return tables


def check_monitor(
    folder: str | Path,
    sources: Sequence[str | Path] | str | Path,
    level: float = 0.05,
    seed: int = 0,
) -> pd.DataFrame:
    """Test whether scores of new fault-free operations have a monitor's calibrated distribution.

    The table has a row for the monitor's score, then one for each signal's. Columns: score, place
    (median rank of the new scores among the scores of the calibration, 0 to 1), martingale (largest
    value of a sequential test), p (p-value of a rank test and this sequential test together),
    adjusted (p, corrected for the number of scores), shifted (whether adjusted is at most `level`).
    The attrs contain the level, and the numbers of new units, operations, hours and alarms.
    sources: as for `ravenjax monitor check`. Raise UserError and StoreError.
    """
    from ravenjax.analyses.monitors import checking

    source_list = [sources] if isinstance(sources, str | Path) else sources
    paths = [Path(source) for source in source_list]
    return checking.check_exchangeability(Path(folder), paths, level, seed)


def _folder(campaign: Any) -> Path | None:
    """Return the path of the result folder that `campaign` is or opened; None for a campaign."""
    path = campaign.folder if isinstance(campaign, CampaignResults) else campaign
    return Path(path) if result_folder(path) else None


def _config(campaign: Any) -> CampaignConfig:
    """Return the configuration of a campaign, which is an object, nested tables, or a file."""
    if isinstance(campaign, Campaign):
        return campaign.config
    return campaign if isinstance(campaign, CampaignConfig) else load_campaign(campaign)

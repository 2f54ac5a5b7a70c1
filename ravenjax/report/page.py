"""One self-contained HTML page from a result folder: opens offline, asks nothing of the network."""

from __future__ import annotations

from pathlib import Path

import jinja2
import markupsafe
import pandas as pd
import plotly.offline

from ravenjax.report import facts as run_facts
from ravenjax.report import figures, maps, tables, wording
from ravenjax.store import folder as results
from ravenjax.store import manifest as manifests
from ravenjax.store import schema
from ravenjax.store.files import write_aside
from ravenjax.store.manifest import Manifest

FILE = "report.html"


def build(folder: Path) -> Path:
    """Write report.html into a result folder and return its path.

    Raises StoreError where the folder holds no readable result.
    """
    folder = Path(folder)
    manifest = manifests.read(folder)
    html = render(results.read_all(folder), manifest, folder)
    path = folder / FILE
    write_aside(path, lambda target: target.write_bytes(html.encode()))
    return path


def render(frame: pd.DataFrame, manifest: Manifest, folder: Path) -> str:
    """The page of a result table; `folder` is what the replay commands name."""
    cue = manifest.cues[manifest.verdict_cue] if manifest.cues else None
    facts = run_facts.derive(frame, manifest.verdict_cue, cue.threshold_mm if cue else 3.0)
    faulty = facts.loc[facts["faulty"]]
    curves, timing = figures.incidence_curves(facts, manifest)
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            manifest=manifest,
            cue=cue,
            jump=next(c.meaning for c in schema.columns(manifest.shape) if c.name == manifest.verdict_jump),
            frame_rows=len(frame),
            head=tables.headline(facts),
            outcomes=run_facts.OUTCOMES,
            matrix_rows=tables.verdict_matrix(faulty),
            groups=tables.group_rows(facts),
            maps=maps.evasion_maps(facts),
            curves=curves,
            timing=timing,
            lead=figures.lead_histogram(facts),
            cues=tables.cue_rows(frame, facts, manifest),
            checks=tables.check_rows(frame, facts, manifest),
            causes=tables.cause_rows(frame, facts),
            worst=tables.worst_rows(frame, facts, folder),
            failures=tables.failure_rows(frame, facts, folder),
            plotly_js=markupsafe.Markup(plotly.offline.get_plotlyjs()),
        )
    )


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("ravenjax.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "count": wording.count,
        "number": wording.number,
        "percent": wording.percent,
        "interval": wording.interval,
        "figure_json": lambda text: markupsafe.Markup(text.replace("</", "<\\/")),
    }
    return environment

"""One self-contained HTML page from a result folder: opens offline, asks nothing of the network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jinja2
import markupsafe
import pandas as pd
import plotly.offline

from ravenjax.hazards import naming, severity
from ravenjax.report import (
    answers,
    cue_figure,
    cue_sweep,
    dependence,
    detector_figures,
    detectors,
    downloads,
    figures,
    maps,
    precision,
    reaction_figures,
    reactions,
    replay_figure,
    replays,
    risk,
    tables,
    wording,
)
from ravenjax.report import facts as run_facts
from ravenjax.store import folder as results
from ravenjax.store import manifest as manifests
from ravenjax.store import schema
from ravenjax.store.files import write_aside
from ravenjax.store.manifest import Manifest

FILE = "report.html"
SECTIONS = {
    "verdicts": "Verdicts",
    "groups": "Groups",
    "maps": "Evasion maps",
    "time": "Time to know",
    "detectors": "Detectors",
    "cues": "Haptic sweep",
    "reaction": "Reaction",
    "robots": "Robots",
    "risk": "Risk",
    "checks": "Checks",
    "worst": "Worst runs",
    "paths": "Paths",
    "precision": "Precision",
    "failures": "Failures",
    "provenance": "Provenance",
}
"""Id and short title of each section, in order; one that has nothing to say is left out."""


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
    """The page of a result table; `folder` is what the replay commands name, and where traces are looked for."""
    cue = manifest.cues[manifest.verdict_cue] if manifest.cues else None
    facts = run_facts.of(frame, manifest)
    told: dict[str, Any] = {
        **_verdicts(frame, facts, manifest, folder),
        **_knowledge(frame, facts, manifest),
        **_robots(frame, facts, manifest),
        **_paths(frame, facts, folder),
    }
    absent = {
        "detectors": not manifest.detectors,
        "reaction": not manifest.shape.reacts,
        "robots": not told["conclusions"],
        "risk": not told["risks"],
        "precision": not told["precision"],
    }
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            manifest=manifest,
            sections=[(name, title) for name, title in SECTIONS.items() if not absent.get(name)],
            cue=cue,
            harm=run_facts.HARM,
            jump=next(c.meaning for c in schema.columns(manifest.shape) if c.name == manifest.verdict_jump),
            frame_rows=len(frame),
            outcomes=run_facts.OUTCOMES,
            plotly_js=markupsafe.Markup(plotly.offline.get_plotlyjs()),
            **told,
        )
    )


def _verdicts(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest, folder: Path) -> dict[str, Any]:
    """What became of the runs."""
    curves, timing = figures.incidence_curves(facts, manifest)
    matrix, shares = tables.verdict_matrix(facts.loc[facts["faulty"]]), maps.evasion_maps(facts.loc[facts["plain"]])
    return {
        "head": tables.headline(facts),
        "matrix_rows": matrix,
        "matrix_csv": tables.matrix_cells(matrix),
        "groups": tables.group_rows(facts),
        "maps": shares,
        "map_csv": maps.cells(shares),
        "curve_csv": {name: figures.points(timing[name]["curve"]) for name in ("cue", "response")},
        "curves": curves,
        "timing": timing,
        "lead": figures.lead_histogram(facts),
        "checks": tables.check_rows(frame, facts, manifest),
        "causes": tables.cause_rows(frame, facts),
        "worst": tables.worst_rows(frame, facts, folder),
        "failures": tables.failure_rows(frame, facts, folder),
    }


def _knowledge(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest) -> dict[str, Any]:
    """Who could know when, and what the cue would change."""
    found = detectors.alarms(frame, facts, manifest)
    known_ms = detectors.known_ms(facts, found)
    differences = reactions.differences(frame, facts) if reactions.crossed(frame, facts) else []
    sweep = cue_sweep.rows(frame, facts, manifest)
    out: dict[str, Any] = {
        "free": run_facts.motions(frame, facts),
        "class_words": answers.CLASSES,
        "most_classes": answers.MOST_CLASSES,
        "known": answers.knowledge(facts, known_ms, manifest),
        "classes": answers.classes(facts, known_ms, manifest),
        "changed": answers.changed(frame, facts, manifest, differences),
        "cues": sweep,
        "choices": cue_sweep.choices(sweep),
        "tradeoff": cue_figure.tradeoff(sweep),
        "detectors": [],
        "differences": differences,
        "interruptions": reactions.interruptions(frame, facts) if manifest.shape.reacts else [],
        "distances": reactions.DISTANCES,
    }
    out["free_hours"] = run_facts.hours(out["free"])
    if manifest.detectors:
        rows, times = detectors.rows(frame, facts, manifest, found), detectors.curves(facts, manifest, found)
        out |= {
            "detectors": rows,
            "roc": detector_figures.roc(rows),
            "precision_recall": detector_figures.precision_recall(rows),
            "alarm_delays": detector_figures.delays(times, manifest.duration_ms),
            "alarm_leads": detector_figures.leads(times),
        }
    if differences:
        spared, height = reaction_figures.spared(differences)
        exceedance, measure = reaction_figures.exceedance(frame, facts)
        out |= {
            "spared": spared,
            "spared_height": height,
            "exceedance": exceedance,
            "exceeded": measure,
        }
    return out


def _robots(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest) -> dict[str, Any]:
    """What depends on the robot, what is risky, and how sharp it all is."""
    conclusions, risks = dependence.conclusions(frame, facts), []
    if any(naming.hazards_of(str(group)) for group in facts["group"].cat.categories):
        risks = risk.by_hazard(risk.counts(frame, manifest.verdict_cue if manifest.cues else None))
    return {
        "conclusions": conclusions,
        "dependence_rows": dependence.flat(conclusions),
        "risks": risks,
        "risk_rows": [
            {"hazard": one.hazard, "mean": one.mean, "injury": one.injury, "silent": one.silent}
            | {f"severity_{grade}": count for grade, count in enumerate(one.counts)}
            for one in risks
        ],
        "severities": severity.SCALE,
        "precision": precision.rows(facts),
    }


def _paths(frame: pd.DataFrame, facts: pd.DataFrame, folder: Path) -> dict[str, Any]:
    """Tip paths of traced runs."""
    found, broken = replays.find(folder, frame, facts)
    return {
        "replays": found,
        "replay_figures": [replay_figure.path(one) for one in found],
        "replay_courses": [json.dumps(replay_figure.course(one), allow_nan=False) for one in found],
        "broken_traces": broken,
    }


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
        "estimate": wording.estimate,
        "bounds": wording.bounds,
        "hundredths": wording.hundredths,
        "points": wording.points,
        "signed_points": wording.signed_points,
        "point_bounds": wording.point_bounds,
        "as_json": json.dumps,
        "csv": downloads.text,
        "figure_json": lambda text: markupsafe.Markup(text.replace("<", "\\u003c")),
    }
    return environment

"""One self-contained HTML page from a result folder: opens offline, asks nothing of the network."""

from __future__ import annotations

import contextlib
import functools
import json
from pathlib import Path
from typing import Any

import jinja2

from ravenjax.campaign.stop import decisions
from ravenjax.document import html
from ravenjax.document.tables import with_scopes
from ravenjax.hazards import naming, severity, titles
from ravenjax.outcomes import definitions
from ravenjax.report import downloads, wording
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data import fault_free
from ravenjax.report.data.runs import Runs
from ravenjax.report.run import path_figure, paths, worst
from ravenjax.report.sections import (
    after_stop,
    answers,
    contact,
    dependence,
    overloads,
    own_checks,
    precision,
    risk,
    tables,
    time_to_know,
    your_robot,
)
from ravenjax.report.sections.chains import section as chain_section
from ravenjax.report.sections.cues import choice, figure
from ravenjax.report.sections.cues import sweep as cue_sweep
from ravenjax.report.sections.detection import figures as detector_figures
from ravenjax.report.sections.detection import performance
from ravenjax.report.sections.maps import panels
from ravenjax.report.sections.motion import operator
from ravenjax.report.sections.reaction import figures as reaction_figures
from ravenjax.report.sections.reaction import pairs as reactions
from ravenjax.stats.bootstrap import units
from ravenjax.store import manifest as manifests
from ravenjax.store.files import write_aside
from ravenjax.store.manifest import Manifest

FILE = "report.html"
SECTIONS = {
    "verdicts": "Verdicts",
    "groups": "Groups",
    "maps": "Maps",
    "time": "Time to know",
    "detectors": "Detectors",
    "cues": "Haptic sweep",
    "reaction": "Reaction",
    "robots": "Robots",
    "risk": "Risk",
    "own_checks": "Your checks",
    "checks": "Built-in checks",
    "after_stop": "After a stop",
    "contact": "Contact",
    "worst": "Worst runs",
    "chains": "Chains",
    "paths": "Paths",
    "operator": "Operator",
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
    with contextlib.closing(Runs.open(folder, manifest)) as runs:
        html = render(runs, manifest, folder)
    path = folder / FILE
    write_aside(path, lambda target: target.write_bytes(html.encode()))
    return path


def render(runs: Runs, manifest: Manifest, folder: Path) -> str:
    """The page of a result table; `folder` is what the replay commands name, and where traces
    are looked for.
    """
    cue = manifest.cues[manifest.verdict_cue] if manifest.cues else None
    content: dict[str, Any] = {
        **_verdicts(runs, manifest, folder),
        **_knowledge(runs, manifest, folder),
        **_robots(runs, manifest),
        **_paths(runs, folder),
        "operator": operator.section(manifest.operator),
        "chains": chain_section.section(runs, manifest, folder),
    }
    absent = {
        "detectors": not manifest.detectors,
        "own_checks": not (manifest.shape.own_checks and content["head"]["evaded"].n),
        "reaction": not manifest.shape.reacts,
        "robots": not (content["conclusions"] or content["your_robot"]),
        "risk": not content["risks"],
        "operator": content["operator"] is None,
        "precision": not content["precision"],
        "after_stop": not content["stops"],
        "contact": not content["contacts"],
        "chains": content["chains"] is None,
    }
    return with_scopes(
        _environment()
        .get_template("page.html.j2")
        .render(
            manifest=manifest,
            sections=[(name, title) for name, title in SECTIONS.items() if not absent.get(name)],
            cue=cue,
            limit=f"{manifest.limit_mm:g} mm",
            robot=manifest.robot,
            definitions=_definitions(manifest),
            frame_rows=runs.rows,
            stopped=decisions.sentence(folder),
            outcomes=run_facts.OUTCOMES,
            **content,
        )
    )


def _definitions(manifest: Manifest) -> list[definitions.Definition]:
    """The words that this campaign's results have."""
    rows = definitions.rows(manifest.rules, manifest.robot)
    return [one for one in rows if one.word != definitions.OVERLOADED or manifest.shape.cables]


def _verdicts(runs: Runs, manifest: Manifest, folder: Path) -> dict[str, Any]:
    """What became of the runs."""
    matrix, shares = tables.verdict_matrix(runs), panels.all_maps(runs)
    worst_runs = worst.rows(runs, manifest, folder)
    return {
        "head": tables.headline(runs, manifest),
        "matrix_rows": matrix,
        "matrix_csv": tables.matrix_cells(matrix),
        "jumps": tables.jump_rows(runs, manifest),
        "overloads": overloads.rows(runs, manifest),
        "cables_break": (manifest.config.get("campaign") or {}).get("cables") == "break",
        "groups": tables.group_rows(runs),
        "maps": shares,
        "map_csv": panels.cells(shares),
        "map_least": panels.MIN_RUNS,
        "lead": time_to_know.lead_histogram(runs),
        "checks": tables.check_rows(runs, manifest),
        "causes": tables.cause_rows(runs),
        "own_checks": own_checks.rows(runs, manifest),
        "worst": worst_runs,
        "worst_csv": worst.flat(worst_runs),
        "stops": after_stop.rows(runs, manifest.limit_mm),
        "contacts": contact.rows(runs, manifest),
        "failures": tables.failure_rows(runs, folder),
    }


def _knowledge(runs: Runs, manifest: Manifest, folder: Path) -> dict[str, Any]:
    """Who could know when, and what the cue would change."""
    alarms = performance.alarms(runs, manifest)
    first_ms, early_ms = performance.known(alarms), performance.before_motion(alarms)
    knowledge = answers.knowledge(runs, first_ms, early_ms, manifest)
    curves, timing = time_to_know.incidence_curves(runs, manifest, knowledge.delay)
    pairs = reactions.drawn(runs) if manifest.shape.reacts else None
    differences = (
        reactions.differences(pairs.frame, pairs.facts, runs.sampled)
        if pairs and pairs.crossed
        else []
    )
    sweep = cue_sweep.rows(runs, manifest)
    choices = choice.choices(runs, sweep)
    hours = choice.hours_to_offer(choices)
    out: dict[str, Any] = {
        "free": runs.motions(),
        "free_hours_wanted": hours,
        "free_recorded": bool((manifest.config.get("operator") or {}).get("file")),
        "free_command": fault_free.command(folder, manifest, hours) if hours else None,
        "class_words": answers.CLASSES,
        "most_classes": answers.MOST_CLASSES,
        "axis_end": answers.scale,
        "curve_csv": {name: time_to_know.points(timing[name]["curve"]) for name in ("cue", "told")},
        "curves": curves,
        "timing": timing,
        "known": knowledge,
        "classes": answers.classes(runs, first_ms, early_ms, manifest),
        "changed": answers.changed(runs, manifest, differences),
        "cues": sweep,
        "choices": choices,
        "tradeoff": figure.tradeoff(sweep),
        "felt_runs": min(cue_sweep.MOST, sweep[0].missed.n) if sweep else 0,
        "detectors": [],
        "curve_runs": performance.curve_runs(runs),
        "differences": differences,
        "interruptions": reactions.interruptions(pairs.frame, pairs.facts) if pairs else [],
        "reaction_runs": (len(pairs.frame), runs.rows) if pairs else (0, 0),
    }
    if manifest.detectors:
        rows, times = (
            performance.rows(runs, manifest, alarms),
            performance.curves(runs, manifest, alarms),
        )
        out |= {
            "detectors": rows,
            "roc": detector_figures.roc(rows),
            "precision_recall": detector_figures.precision_recall(rows),
            "alarm_delays": detector_figures.delays(times, manifest.duration_ms),
            "alarm_leads": detector_figures.leads(times),
        }
    if pairs and differences:
        exceedance = reaction_figures.exceedance(pairs.frame, pairs.facts)
        out |= {
            "spared": reaction_figures.spared(differences),
            "exceedance": exceedance,
        }
    return out


def _robots(runs: Runs, manifest: Manifest) -> dict[str, Any]:
    """What depends on the robot, what is risky, and how sharp it all is."""
    conclusions, risks = dependence.conclusions(runs, your_robot.drawn_whole(runs, manifest)), []
    if any(naming.hazards_of(group) for group in runs.groups()):
        cue = manifest.verdict_cue if manifest.cues else None
        risks = risk.by_hazard(risk.counted(runs, cue, manifest.limit_mm))
    return {
        "conclusions": conclusions,
        "dependence_rows": dependence.flat(conclusions),
        "fewest_units": units.FEWEST,
        "few_units": units.FEW,
        "your_robot": your_robot.rates(runs, manifest),
        "risks": risks,
        "risk_rows": [
            {"hazard": one.hazard, "mean": one.mean, "injury": one.injury, "silent": one.silent}
            | {f"severity_{grade}": count for grade, count in enumerate(one.counts)}
            for one in risks
        ],
        "severities": severity.SCALE,
        "depth_mm": severity.DEPTH_MM,
        "sampled": runs.sampled(),
        "precision": precision.rows(runs),
    }


def _paths(runs: Runs, folder: Path) -> dict[str, Any]:
    """Tip paths of traced runs."""
    replays, broken = paths.find(folder, runs)
    return {
        "replays": replays,
        "replay_figures": [path_figure.distance(one) for one in replays],
        "replay_views": [path_figure.views(one) for one in replays],
        "replay_courses": [json.dumps(path_figure.course(one), allow_nan=False) for one in replays],
        "broken_traces": broken,
    }


@functools.cache
def _environment() -> jinja2.Environment:
    environment = html.environment("ravenjax.report")
    environment.filters |= {
        "count": wording.count,
        "number": wording.number,
        "hours": wording.hours,
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
        "hazard_titles": titles.of_group,
    }
    return environment

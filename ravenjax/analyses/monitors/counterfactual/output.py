"""Writes the results of `ravenjax counterfactual`: a table of candidate checks, a figure and a
campaign.

The campaign contains the selected checks. The figure shows the share of faults that are detected at
least a given number of milliseconds before harm.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.monitors import code
from ravenjax.analyses.monitors.counterfactual.finding import Counterfactual
from ravenjax.analyses.monitors.counterfactual.promise import Promise
from ravenjax.campaign import writing
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.report import downloads, wording
from ravenjax.report.data.fault_free import rounded_up
from ravenjax.report.drawing import save_panels
from ravenjax.stats.alarms.false_alarms import hours_to_bound
from ravenjax.stats.intervals import rate_bounds
from ravenjax.store.files import require_writable, write_text

SHOWN = 0.95
"""Share of the lead times that lie within the range of the axis."""


def draw_figure(one: Counterfactual, path: Path) -> None:
    """Write the figure as SVG: share of detected faults over the time from alarm to harm."""
    named: list[tuple[str, Promise]] = [
        (wording.count_noun(len(one.promise.members), "check"), one.promise),
        (f"best single check: {one.parts[one.best.members[0]].name}", one.best),
        (f"all {len(one.parts)} candidates", one.everything),
    ]
    if one.tip_error is not None:
        named.insert(2, ("built-in tip-error detector", one.tip_error))
    leads = [
        one.grounds.leads(promise.members, promise.margin.place)[one.grounds.statement_half]
        for _, promise in named
    ]
    positive = leads[0][leads[0] > 0]
    shown = float(np.quantile(positive, SHOWN)) if len(positive) else 1.0
    end = max(shown, 2.0 * one.question.lead_ms, 10.0)
    ms = np.linspace(0.0, end, 200)
    curves = []
    for number, ((name, _), lead) in enumerate(zip(named, leads, strict=True)):
        early = (lead[:, None] >= ms).mean(axis=0)
        low = high = ()
        if not number and not one.grounds.hazards.robots:
            low, high = rate_bounds(np.round(early * len(lead)), np.full(len(early), len(lead)))
        curves.append(
            Curve(name, palette.series_colour(number), ms, early, low, high, dashed=number > 0)
        )
    required = float(one.question.lead_ms) or None
    across = ChartAxis("time before harm, at least, ms", 0.0, end, unit="ms", line=required)
    up = ChartAxis("share of faults detected", 0.0, 1.0, share=True)
    save_panels(path, [Chart("", across, up, tuple(curves))])


TABLE, FIGURE = "counterfactual.csv", "counterfactual.svg"
FOLDER, CAMPAIGN = "chosen", "campaign.toml"


def write_files(one: Counterfactual, out_folder: Path) -> list[Path]:
    """Write all files and return their paths. Raise StoreError if a file cannot be written."""
    folder = out_folder / FOLDER
    require_writable(folder)
    paths = [out_folder / TABLE, out_folder / FIGURE]
    write_text(paths[0], downloads.format_csv(candidate_table(one)))
    draw_figure(one, paths[1])
    for member, name in zip(one.promise.members, detector_names(one), strict=True):
        part = one.parts[member]
        paths.append(folder / f"{name}.py")
        title = (
            f"{part.words[:1].upper()}{part.words[1:]}. The score is 1 at the largest value in"
            " fault-free motion"
        )
        write_text(paths[-1], code.write_part(part.score.singles, title=title))
    paths.append(folder / CAMPAIGN)
    write_text(paths[-1], campaign_with_set(one))
    return paths


def detector_names(one: Counterfactual) -> list[str]:
    """Return a name for each detector of the set, different from the campaign's detectors."""
    others, out = {own.name for own in one.config.detector}, []
    for member in one.promise.members:
        name, number = one.parts[member].name, 2
        while name in others:
            name, number = f"{one.parts[member].name}_{number}", number + 1
        others.add(name)
        out.append(name)
    return out


def campaign_with_set(one: Counterfactual) -> str:
    """Return the campaign as TOML, with the set as additional detectors."""
    raw: dict[str, Any] = one.config.model_dump(mode="json", exclude_defaults=True)
    raw["campaign"]["name"] = f"{one.config.campaign.name[:90]}_watched"
    margin = one.promise.margin.value
    more = [
        {
            "name": name,
            "file": f"{name}.py",
            "consecutive": one.parts[member].consecutive,
            "threshold": [margin],
            "acts": "watch",
        }
        for member, name in zip(one.promise.members, detector_names(one), strict=True)
    ]
    own, groups = raw.pop("detector", []), raw.pop("group")
    head = "".join(f"# {sentence}\n" for sentence in finding_sentences(one))
    stop = (
        '# With acts = "stop" a check presses the E-stop. For other random faults: --set'
        " campaign.seed=N\n"
    )
    return f"{head}{stop}\n" + writing.format_toml(
        {**raw, "detector": [*own, *more], "group": groups}
    )


def finding_sentences(one: Counterfactual) -> list[str]:
    """Return sentences that state the findings and the limits of their validity."""
    templates = wording.text_templates("ravenjax.analyses.monitors.counterfactual")
    templates.filters |= {
        "quantile": np.quantile,
        "listed": lambda names: " and ".join(filter(None, [", ".join(names[:-1]), names[-1]])),
    }
    text = templates.get_template("sentences.txt.j2")
    return text.render(one=one, hours_needed=hours_needed).splitlines()


def hours_needed(per_hour: float, runs: int = 1) -> float:
    """Return the hours of motion that show a false-alarm rate if there is no alarm, rounded up."""
    # Only half of the motions measure the rate, and the robot is not live in their first seconds.
    return rounded_up(2.05 * runs * hours_to_bound(per_hour))


def candidate_table(one: Counterfactual) -> list[dict[str, object]]:
    """Return the rows of `counterfactual.csv`, one per candidate."""
    return [
        {
            "candidate": part.name,
            "chosen": number in one.promise.members,
            "kind": part.score.kind,
            "signal": part.score.signal,
            "against": part.score.against,
            "layer": part.score.layer,
            "consecutive_ticks": part.consecutive,
            "looks_at": part.words,
            "scales": "; ".join(
                f"{label} {scale!r} {unit}".strip()
                for label, unit, scale in zip(
                    part.score.labels, part.score.units, part.score.scales, strict=True
                )
            ),
            "margin": alone.margin.value,
            "calibrated_false_alarms_per_hour": alone.margin.bound,
            "false_alarms": alone.false_alarms,
            "selection": alone.selected,
            "statement": alone.covered,
            "lead_ms": alone.lead_ms,
        }
        for number, (part, alone) in enumerate(zip(one.parts, one.alone, strict=True))
    ]

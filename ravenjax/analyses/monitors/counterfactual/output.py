"""Writes the results of `ravenjax counterfactual`: a table of checks, a figure and a campaign.

The campaign contains the selected checks. The figure shows the share of faults that are detected at
least a given number of milliseconds before harm.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.monitors import code
from ravenjax.analyses.monitors.counterfactual.check_set import CheckSet
from ravenjax.analyses.monitors.counterfactual.finding import Counterfactual
from ravenjax.campaign import writing
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.report import downloads, wording
from ravenjax.report.data.fault_free import rounded_up
from ravenjax.report.drawing import save_panels
from ravenjax.stats.alarms.false_alarms import hours_to_bound
from ravenjax.stats.intervals import rate_bounds
from ravenjax.store.files import require_writable, write_text

SHOWN_SHARE = 0.95
"""Share of the lead times that lie within the range of the axis."""


def draw_figure(finding: Counterfactual, path: Path) -> None:
    """Write a figure as SVG: the share of the test half's faults that a set of checks detects at
    least a given time before the harm. The curves of sets that were not selected are dashed.
    """
    best_single_set = finding.best_single_set
    best_single = finding.candidates[best_single_set.indices[0]]
    selected_name = wording.count_noun(len(finding.selected_set.indices), "check")
    sets: dict[str, CheckSet] = {
        selected_name: finding.selected_set,
        f"best single check: {best_single.name}": best_single_set,
    }
    if finding.tip_error_set is not None:
        sets["built-in tip-error detector"] = finding.tip_error_set
    sets[f"all {len(finding.candidates)} candidates"] = finding.full_set
    evidence = finding.evidence
    lead_ms = {
        name: evidence.lead_times(checks.indices, checks.margin.index)[evidence.test_half]
        for name, checks in sets.items()
    }
    positive_ms = lead_ms[selected_name][lead_ms[selected_name] > 0]
    shown_ms = float(np.quantile(positive_ms, SHOWN_SHARE)) if len(positive_ms) else 1.0
    end_ms = max(shown_ms, 2.0 * finding.question.lead_ms, 10.0)
    axis_ms = np.linspace(0.0, end_ms, 200)
    curves = []
    for number, (name, set_lead_ms) in enumerate(lead_ms.items()):
        share = (set_lead_ms[:, None] >= axis_ms).mean(axis=0)
        low = high = ()
        # Only the selected set has a band, which assumes that faults are independent.
        if name == selected_name and not evidence.faults.units_are_robots:
            fault_count = np.full(len(share), len(set_lead_ms))
            low, high = rate_bounds(np.round(share * len(set_lead_ms)), fault_count)
        colour = palette.series_colour(number)
        curves.append(Curve(name, colour, axis_ms, share, low, high, dashed=name != selected_name))
    # A required lead time of 0 needs no line.
    required_ms = float(finding.question.lead_ms) or None
    time_axis = ChartAxis(
        "time before harm, at least, ms", 0.0, end_ms, unit="ms", line=required_ms
    )
    share_axis = ChartAxis("share of faults detected", 0.0, 1.0, share=True)
    save_panels(path, [Chart("", time_axis, share_axis, tuple(curves))])


TABLE, FIGURE = "counterfactual.csv", "counterfactual.svg"
FOLDER, CAMPAIGN = "chosen", "campaign.toml"


def write_files(finding: Counterfactual, out_folder: Path) -> list[Path]:
    """Write the table, the figure, the detectors and the campaign. Return their paths, the campaign
    last. Raise StoreError if a file cannot be written.
    """
    folder = out_folder / FOLDER
    require_writable(folder)
    paths = [out_folder / TABLE, out_folder / FIGURE]
    write_text(paths[0], downloads.format_csv(candidate_table(finding)))
    draw_figure(finding, paths[1])
    for index, name in zip(finding.selected_set.indices, detector_names(finding), strict=True):
        candidate = finding.candidates[index]
        paths.append(folder / f"{name}.py")
        title = (
            f"{candidate.words[:1].upper()}{candidate.words[1:]}. The score is 1 at the largest"
            " value in fault-free motion"
        )
        write_text(paths[-1], code.write_part(candidate.score.channel_scores, title=title))
    paths.append(folder / CAMPAIGN)
    write_text(paths[-1], campaign_with_set(finding))
    return paths


def detector_names(finding: Counterfactual) -> list[str]:
    """Return a name for each check of the selected set, as a detector of the campaign: the name of
    the candidate, with a number if the campaign has a detector of this name already.
    """
    used_names = {detector.name for detector in finding.config.detector}
    names = []
    for index in finding.selected_set.indices:
        name, number = finding.candidates[index].name, 2
        while name in used_names:
            name, number = f"{finding.candidates[index].name}_{number}", number + 1
        used_names.add(name)
        names.append(name)
    return names


def campaign_with_set(finding: Counterfactual) -> str:
    """Return the campaign as TOML, with the selected set as additional detectors."""
    raw: dict[str, Any] = finding.config.model_dump(mode="json", exclude_defaults=True)
    # A name has at most 100 letters.
    raw["campaign"]["name"] = f"{finding.config.campaign.name[:90]}_watched"
    added = [
        {
            "name": name,
            "file": f"{name}.py",
            "consecutive": finding.candidates[index].consecutive,
            "threshold": [finding.selected_set.margin.value],
            "acts": "watch",
        }
        for index, name in zip(finding.selected_set.indices, detector_names(finding), strict=True)
    ]
    # Detectors and groups are the last tables of the file, as users write them.
    present, groups = raw.pop("detector", []), raw.pop("group")
    tables = {**raw, "detector": [*present, *added], "group": groups}
    findings = "".join(f"# {sentence}\n" for sentence in finding_sentences(finding))
    hint = (
        '# With acts = "stop" a check presses the E-stop. For other random faults: --set'
        " campaign.seed=N\n"
    )
    return f"{findings}{hint}\n{writing.format_toml(tables)}"


def finding_sentences(finding: Counterfactual) -> list[str]:
    """Return sentences that state the findings and the limits of their validity."""

    def join_names(names: list[str]) -> str:
        # Returns "a", "a and b" or "a, b and c".
        return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))

    templates = wording.text_templates("ravenjax.analyses.monitors.counterfactual")
    templates.filters |= {"quantile": np.quantile, "listed": join_names}
    text = templates.get_template("sentences.txt.j2")
    return text.render(finding=finding, hours_needed=hours_needed).splitlines()


def hours_needed(per_hour: float, runs: int = 1) -> float:
    """Return the hours of fault-free motion, `Question.hours`, that show a false-alarm rate of at
    most `per_hour` if no alarm occurs, rounded up. runs: number of runs of each motion, which
    count once, because they have the same motion.
    """
    # Only half of the motions measure the rate: 2. Robots are not live at the start: 0.05.
    return rounded_up(2.05 * runs * hours_to_bound(per_hour))


def candidate_table(finding: Counterfactual) -> list[dict[str, object]]:
    """Return the rows of `counterfactual.csv`: a candidate and its results as the only check."""
    rows = []
    for index, (candidate, single_set) in enumerate(
        zip(finding.candidates, finding.single_sets, strict=True)
    ):
        score = candidate.score
        channels = zip(score.labels, score.units, score.scales, strict=True)
        # A channel without label or unit has an empty string, which leaves a space at an end.
        scales = [f"{label} {scale!r} {unit}".strip() for label, unit, scale in channels]
        rows.append(
            {
                "candidate": candidate.name,
                "chosen": index in finding.selected_set.indices,
                "kind": score.kind,
                "signal": score.signal,
                "against": score.against,
                "layer": score.layer,
                "consecutive_ticks": candidate.consecutive,
                "looks_at": candidate.words,
                "scales": "; ".join(scales),
                "margin": single_set.margin.value,
                "calibrated_false_alarms_per_hour": single_set.margin.expected_per_hour,
                "false_alarms": single_set.false_alarms,
                "selection": single_set.selection_coverage,
                "statement": single_set.test_coverage,
                "lead_ms": single_set.median_lead_ms,
            }
        )
    return rows

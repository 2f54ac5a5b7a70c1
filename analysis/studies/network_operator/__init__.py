"""Study: how does an operator who corrects by sight perform over a bad network, and how much does
the haptic cue help such an operator?

The operator (hands.py) is fitted to people under the mildest network faults (fit.py), and predicts
results under worse faults. Published rows for the worse faults are not read.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.report.sections.reaction import Pairs
from ravenjax.stats.intervals import Estimate
from studies import kinds, reacting_operator, study
from studies.dsn16 import recording
from studies.network_operator import fit
from studies.network_operator.fit import LOWEST, NUMBERS, WORSE
from studies.reacting_operator import number
from studies.runs import Runs, acting_pairs, read
from studies.series import Recorder, Row, Series, own_operator
from studies.study import Cell, Line, StudyEstimate, own_line

NAME = "network_operator"
HERE = Path(__file__).parent
FILE = "operators_under_network_faults.csv"
FROM_MS = 3000
"""Begin of the measurement, and of the first communication loss."""
COUNTED = ("done_ms", "path_mm", "tests")
WORDS = ("time", "path of the robot", "path of the hands", "presses of the pedal")
"""The quantities of the fit, in its order."""
SIZES_MM = (10.0, 20.0)
GRID = "grid_"
"""Prefix of the variants with the grid of operators."""
OPEN, CLOSED = "hands follow their plan", "hands correct by sight"
OTHERS = f"{CLOSED}, drawn operators"
HANDS = "param:operator.own.hands."
Judged = dict[str, dict[str, np.ndarray]]
"""Residuals in standard errors, [QUANTITIES], by condition and model."""


def measure(row: Row, series: Series) -> dict[str, float | str]:
    """Measure a run of the grid, over whole cycles of its network fault."""
    every, last = int(np.nan_to_num(row["fault0_every_ms"])), len(series["tip"]) - 1
    end = FROM_MS + (last - FROM_MS) // every * every if every > 0 else last
    done, hand, tests = (
        float(series[own_operator(name)][end] - series[own_operator(name)][FROM_MS])
        for name in COUNTED
    )
    steps = np.diff(series["tip"][FROM_MS : end + 1 : 10], axis=0)
    seconds = (end - FROM_MS) / 1e3
    return {
        **{name: float(row[f"{HANDS}{name}"]) for name in NUMBERS},
        "condition": str(row["group"]).partition("/")[0],
        # A network with losses of several lengths has as many of each
        "weight": (every or 1) / seconds,
        "done": done / 1e3,
        "time": seconds,
        "robot": float(np.sqrt((steps**2).sum(axis=1)).sum() * 1e3),
        "hand": hand,
        "tests": tests,
    }


def predictions(
    every: fit.Operators, people: fit.People
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the ratios to NORMAL of 15 other people, by condition, and the operator's numbers with
    the reach, over resampled people: [RESAMPLES, ...]. The first row is the fit.
    """
    random = np.random.default_rng(1)
    found: dict[str, list[np.ndarray]] = {one: [] for one in (*LOWEST, *WORSE)}
    numbers = []
    for sample in range(fit.RESAMPLES + 1):
        drawn = people.drawn(random) if sample else people
        best = fit.fit(every, drawn)
        numbers.append([*every.numbers[best], every.reach(drawn)[best]])
        for condition, rows in found.items():
            error = fit.errors(people, fit.mildest(condition)) * random.normal(size=len(WORDS))
            ratios = every.ratios(drawn, condition)[best]
            rows.append(ratios * np.exp(error) if sample else ratios)
    return {name: np.array(rows) for name, rows in found.items()}, np.array(numbers)


def judged(every: fit.Operators, people: fit.People) -> Judged:
    """Return residuals under mild faults: of the fit, of a fit to the others, of null models."""
    best, found = fit.fit(every, people), {}
    for condition in LOWEST:
        ratios = every.ratios(people, condition)
        without = fit.fit(every, people, [one for one in LOWEST if one != condition])
        beside = {f"null model: {name}": one for name, one in fit.nulls(condition, people).items()}
        del beside[f"null model: {fit.PROPORTION}"]
        of = {"fit": ratios[best], "fit to the other networks": ratios[without], **beside}
        found[condition] = {
            name: fit.residuals(value, people, condition) for name, value in of.items()
        }
    return found


def network_findings(folders: Sequence[Path], table: Path) -> tuple[list[Line], study.Tables]:
    """Return the predictions of the fitted operator and of null models for the worse networks, and
    their residuals for the mild networks. `folders`: of the grid; `table`: of people.
    """
    recorder = Recorder(["tip", *map(own_operator, COUNTED)])
    runs = [pd.DataFrame(recorder.measure(folder, measure)) for folder in folders]
    every, people = fit.operators(pd.concat(runs)), fit.read_people(table)
    found, numbers = predictions(every, people)
    lines, rows = [], []
    for condition in WORSE:
        nulls = fit.nulls(condition, people).values()
        for k, words in enumerate(WORDS):
            mine = _estimate(found[condition][:, k])
            value = StudyEstimate(*mine, of="means of 15 people")
            lines.append(own_line(f"{condition}: {words}, relative to no network fault", "", value))
            rows.append((condition, words, number(mine), *(f"{null[k]:.2f}" for null in nulls)))
    residuals = judged(every, people)
    for words, part in {"": slice(None), ", without presses": slice(3)}.items():
        for name in residuals[LOWEST[0]]:
            of = np.array([models[name][part] for models in residuals.values()])
            value = StudyEstimate(float(np.sqrt((of**2).mean())), n=of.size, of="ratios")
            quantity = f"rms residual for mild networks{words}, {name}"
            lines.append(own_line(quantity, "standard errors", value))
    beside = (
        (condition, words, *(f"{of[k]:+.2f}" for of in models.values()))
        for condition, models in residuals.items()
        for k, words in enumerate(WORDS)
    )
    operator = (
        (name, number(_estimate(numbers[:, k]))) for k, name in enumerate((*NUMBERS, "reach_mm"))
    )
    return lines, {"predictions": rows, "judged": beside, "operator": operator}


def _estimate(samples: np.ndarray) -> Estimate:
    """Return the first sample with the interval of all others."""
    return Estimate(samples[0], *np.quantile(samples[1:], (0.025, 0.975)))


def cue_pairs(runs: dict[str, Runs]) -> dict[str, Pairs]:
    """Return the compared pairs of runs, by the words of the measure. `runs`: of OPEN and so on."""
    sides = {}
    for name, some in runs.items():
        frame, column = some.frame, "param:reaction.action"
        if name != OPEN:
            column, first_ms = f"{HANDS}feels", frame["cue0_first_ms"]
            acts = first_ms + frame[f"{HANDS}feels_after_ms"]
            felt = (frame[column] == 1) & (first_ms >= 0) & (acts < some.made.duration_ms)
            frame = frame.assign(reaction_ms=np.where(felt, acts, -1))
        sides |= {(name, action): frame.loc[frame[column] == action] for action in (0, 1)}
    words = {f"lifted pedal, {name}": ((name, 1), (name, 0)) for name in runs}
    words["correction by sight, nobody reacts to the cue"] = (CLOSED, 0), (OPEN, 0)
    words["correction by sight and lifted pedal"] = (CLOSED, 1), (OPEN, 0)
    return {name: acting_pairs(sides[one], sides[other]) for name, (one, other) in words.items()}


def compare(context: study.Context) -> study.Findings:
    """Fit and predict if the table of people is there, and compare the cues."""
    folders, table = context.folders, recording.locate(FILE)
    lines, tables, absent = [], {}, f" Set {recording.DATA}."
    if table is not None:
        grid = [folder for name, folder in folders.items() if name.startswith(GRID)]
        (lines, tables), absent = network_findings(grid, table), ""
    variants = {OPEN: "open", CLOSED: "closed", OTHERS: "drawn"}
    rows: list[tuple[Cell, ...]] = []
    for name, pairs in cue_pairs({one: read(folders[of]) for one, of in variants.items()}).items():
        for size in SIZES_MM:
            one = reacting_operator.contrast_of(pairs, size)
            of = f"faults with the excursion without this measure, {kinds.count(one.affected)}"
            words = f"{name}: avoided excursions of more than {size:g} mm"
            lines.append(study.percent_line(words, one.avoided, of))
            avoided = reacting_operator.avoided(one)
            rows.append((name, f"{size:g}", one.n, one.without, one.with_, avoided, one.caused))
    return study.findings(NAME, lines, {**tables, "cue": rows}, absent=absent)


STUDY = study.study(NAME, study.read_variants(NAME), compare)

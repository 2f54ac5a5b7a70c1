"""Study: how does an operator who corrects by sight perform over a bad network, and how much does
the haptic cue help such an operator?

The operator (hands.py) is fitted to people under the mildest network faults (fit.py), and predicts
results under worse faults. Published rows for the worse faults are not read.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.report.sections.reaction import Pairs
from ravenjax.stats.intervals import Estimate
from studies import kinds, reacting_operator, study
from studies.dsn16 import recording
from studies.network_operator import fit
from studies.network_operator.fit import LOWEST, NUMBERS, QUANTITIES, WORSE
from studies.reacting_operator import Contrast, number
from studies.runs import Runs, read
from studies.series import Recorder, Row, Series, own_operator
from studies.study import Cell, Line, StudyEstimate, own_line, read_table

NAME = "network_operator"
HERE = Path(__file__).parent
FILE = "operators_under_network_faults.csv"
FROM_MS = 3000
"""Begin of the measurement, and of the first communication loss."""
COUNTED = ("done_ms", "path_mm", "tests")
WORDS = {
    "transfer_s": "time",
    "robot_path_m": "path of the robot",
    "console_path_m": "path of the hands",
    "pedal_presses": "presses of the pedal",
}
"""The quantities of the fit, in its order."""
SIZES_MM = (10.0, 20.0)
GRID = "grid_"
"""Prefix of the variants with the grid of operators."""
OPEN, CLOSED, OTHERS = "open loop", "closed loop", "closed loop, drawn operators"
# --- people and networks ---


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
        **{name: float(row[f"param:operator.own.hands.{name}"]) for name in NUMBERS},
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
    """Return the ratios to NORMAL that other 15 people would have, and the operator's numbers with
    the reach, over resampled people: [RESAMPLES, ...] by condition. The first row is the fit.
    """
    random = np.random.default_rng(1)
    found: dict[str, list[np.ndarray]] = {one: [] for one in (*LOWEST, *WORSE)}
    numbers = []
    for sample in range(fit.RESAMPLES + 1):
        drawn = people.drawn(random) if sample else people
        best = fit.fit(every, drawn)
        numbers.append([*every.numbers[best], every.reach(drawn)[best]])
        for condition, rows in found.items():
            error = fit.errors(people, _lowest(condition)) * random.normal(size=len(QUANTITIES))
            ratios = every.ratios(drawn, condition)[best]
            rows.append(ratios * np.exp(error) if sample else ratios)
    return {name: np.array(rows) for name, rows in found.items()}, np.array(numbers)


def _lowest(condition: str) -> str:
    return next(one for one in LOWEST if one[:3] == condition[:3])


def _estimate(samples: np.ndarray) -> Estimate:
    """Return the first sample with the interval of all others."""
    return Estimate(samples[0], *np.quantile(samples[1:], (0.025, 0.975)))


def network_lines(found: Mapping[str, np.ndarray]) -> Iterator[Line]:
    """Yield the predictions for the worse networks."""
    for condition in WORSE:
        for k, words in enumerate(WORDS.values()):
            value = StudyEstimate(*_estimate(found[condition][:, k]), of="means of 15 people")
            yield own_line(f"{condition}: {words}, by that without a fault", "", value)


def prediction_rows(
    found: Mapping[str, np.ndarray], people: fit.People
) -> Iterator[tuple[Cell, ...]]:
    """Yield the predictions for the worse networks beside null models."""
    for condition in WORSE:
        beside = fit.nulls(condition, people)
        for k, words in enumerate(WORDS.values()):
            mine = number(_estimate(found[condition][:, k]))
            yield condition, words, mine, *(f"{null[k]:.2f}" for null in beside.values())


def judged(every: fit.Operators, people: fit.People) -> dict[str, dict[str, np.ndarray]]:
    """Return residuals in standard errors, [QUANTITIES], by condition and model."""
    best, found = fit.fit(every, people), {}
    for condition in LOWEST:
        others = [one for one in LOWEST if one != condition]
        ratios = every.ratios(people, condition)
        without = fit.fit(every, people, others)
        beside = fit.nulls(condition, people)
        del beside[fit.PROPORTION]
        of = {"fit": ratios[best], "fit without it": ratios[without], **beside}
        found[condition] = {
            name: fit.residuals(value, people, condition) for name, value in of.items()
        }
    return found


def judged_lines(found: Mapping[str, Mapping[str, np.ndarray]]) -> Iterator[Line]:
    """Yield the root mean square residual of every model, with and without the presses."""
    for words, part in {"": slice(None), ", without presses": slice(3)}.items():
        for name in found[LOWEST[0]]:
            of = np.array([models[name][part] for models in found.values()])
            value = StudyEstimate(float(np.sqrt((of**2).mean())), n=of.size, of="ratios")
            yield own_line(
                f"rms residual under mild faults{words}: {name}", "standard errors", value
            )


# --- the cue ---


def cue_contrasts(open_: Runs, closed: Runs, drawn: Runs) -> dict[str, Pairs]:
    """Return what is compared, in words -> pairs. drawn: of operators who differ."""
    feels, after = (f"param:operator.own.hands.{name}" for name in ("feels", "feels_after_ms"))
    sides = {}
    for name, runs, column in (
        (OPEN, open_, "param:reaction.action"),
        (CLOSED, closed, feels),
        (OTHERS, drawn, feels),
    ):
        for action in (0, 1):
            side = runs.frame.loc[runs.frame[column] == action].sort_values("pair")
            if name != OPEN:
                acts = side["cue0_first_ms"] + side[after]
                felt = (side["cue0_first_ms"] >= 0) & (acts < runs.made.duration_ms)
                side = side.assign(reaction_ms=np.where(felt & (action == 1), acts, -1))
            sides[name, action] = side
    both = f"{CLOSED} and lifted pedal instead of {OPEN}"
    words = {f"lifted pedal, {name}": ((name, 1), (name, 0)) for name in (OPEN, CLOSED, OTHERS)}
    words[f"{CLOSED} instead of {OPEN}, nobody feels the cue"] = (CLOSED, 0), (OPEN, 0)
    words[both] = (CLOSED, 1), (OPEN, 0)
    found = {}
    for name, (one, other) in words.items():
        pairs = Pairs(sides[one], sides[other])
        valid = ~(pairs.with_["failed"].to_numpy(bool) | pairs.without["failed"].to_numpy(bool))
        found[name] = pairs.where(valid & pairs.without["activated"].to_numpy(bool))
    return found


def cue_lines(found: Mapping[tuple[str, float], Contrast]) -> Iterator[Line]:
    """Yield the share of excursions that are avoided, and how many are caused."""
    for (name, size), one in found.items():
        of = f"faults that make it otherwise, {kinds.count(one.affected)}"
        words = f"{name}: avoided excursions of more than {size:g} mm"
        yield study.percent_line(words, one.avoided, of)


def cue_rows(found: Mapping[tuple[str, float], Contrast]) -> Iterator[tuple[Cell, ...]]:
    """Yield the comparisons as rows."""
    for (name, size), one in found.items():
        yield (
            *(name, f"{size:g}", one.n, one.without, one.with_),
            *(reacting_operator.avoided(one), one.caused),
        )


def compare(context: study.Context) -> study.Findings:
    """Fit and predict if the table of people is there, and compare the cues."""
    lines: list[Line] = []
    tables: list[study.Table] = []
    path, absent = recording.locate(FILE), f" Set {recording.DATA}."
    if path is not None:
        absent = ""
        recorder = Recorder(["tip", *map(own_operator, COUNTED)])
        grid = [folder for name, folder in context.folders.items() if name.startswith(GRID)]
        runs = [pd.DataFrame(recorder.measure(folder, measure)) for folder in grid]
        every, people = fit.operators(pd.concat(runs)), fit.read_people(path)
        found, numbers = predictions(every, people)
        residuals = judged(every, people)
        lines += [*network_lines(found), *judged_lines(residuals)]
        operator = (
            (name, number(_estimate(numbers[:, k])))
            for k, name in enumerate((*NUMBERS, "reach_mm"))
        )
        beside = (
            (condition, words, *(f"{of[k]:+.2f}" for of in models.values()))
            for condition, models in residuals.items()
            for k, words in enumerate(WORDS.values())
        )
        tables += [
            read_table(NAME, "predictions", prediction_rows(found, people)),
            read_table(NAME, "judged", beside),
            read_table(NAME, "operator", operator),
        ]
    cues = (read(context.folders[name]) for name in ("open", "closed", "drawn"))
    contrasts = {
        (name, size): reacting_operator.contrast_of(part, size)
        for name, part in cue_contrasts(*cues).items()
        for size in SIZES_MM
    }
    lines += cue_lines(contrasts)
    tables.append(read_table(NAME, "cue", cue_rows(contrasts)))
    return study.Findings(tuple(lines), tuple(tables), study.read_notes(NAME, absent=absent))


STUDY = study.study(NAME, study.read_variants(NAME), compare)

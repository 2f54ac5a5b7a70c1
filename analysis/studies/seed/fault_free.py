"""Study of the fault-free tip error of the training simulator at four teleoperation scales (IROS
2016, Figure 3; targets A5, A6). The tip error is the distance that triggers the cue, from the
reported tip to the tip of the nominal model.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from studies import study
from studies.runs import SCALE
from studies.seed.motions import MODELLED, over_kinds, settings_of
from studies.series import Recorder, Row, Series, rises
from studies.study import Line, Published, StudyEstimate, read_table

NAME, NOISE = "seed_fault_free", "noise"
"""NOISE: the campaign's group with noise of encoders and motors, in the robot's own sizes."""
SCALES = (0.05, 0.1, 0.15, 0.2)
VARIANTS = study.read_variants(NAME)
REST_TICKS = 500
"""Ticks for which the hand rests at the beginning of every generated motion."""
WORDS = study.read_toml("published/seed.toml")
KINDS = tuple(WORDS["curved"])
"""Kinds of tip error: peak and mean."""


def segment(row: Row, series: Series) -> dict[str, Any]:
    """Measure a run from its first motion to its end or stop. `row`: of the result table."""
    stop, error = int(row["check_estop_first_ms"]), series["tip_error_mm"]
    moving = slice(REST_TICKS, max(len(error) if stop < 0 else stop, REST_TICKS + 1))
    apart = (series["position"] - series["model_position"]) * 1e3
    zeroed = np.linalg.norm(apart - apart[REST_TICKS - 1], axis=1)
    true = np.linalg.norm(series["tip"] - series["model_position"], axis=1) * 1e3
    return {
        # Setting that differs from the robot as modelled
        "group": str(row["group"]),
        "scale": float(row[SCALE]),
        "peak_mm": float(error[moving].max()),
        "mean_mm": float(error[moving].mean()),
        "true_mean_mm": float(true[moving].mean()),
        # Without the offset of the measured tip at rest
        "zeroed_mean_mm": float(zeroed[moving].mean()),
        "rest_mm": float(error[REST_TICKS - 1]),
        "pulses": len(rises(series["cue_force"][moving] > 0.0)),
        # Time at which the robot stopped, although there is no fault; -1: never
        "stop_ms": stop,
    }


def growth(values: pd.Series) -> pd.Series:
    """Return the straight line through a quantity over the scale: `slope`, mm per unit of scale,
    `at_zero`, mm, and `explained`, its share of the variance (R2). Needs at least three scales.
    """
    x, y = np.asarray(values.index, float), np.asarray(values, float)
    slope, at_zero = np.polyfit(x, y, 1)
    rest, about = y - slope * x - at_zero, y - y.mean()
    explained = 1.0 - rest @ rest / (about @ about) if about.any() else 1.0
    return pd.Series({"explained": explained, "slope": slope, "at_zero": at_zero})


def compare(context: study.Context) -> study.Findings:
    """Measure every segment and compare it with the paper's."""
    measured, published = _measured(context), Published("seed")
    settings = {
        str(name): frame.set_index(["kind", "seed", "scale"]).unstack(sort=False)
        for name, frame in measured.groupby("setting", sort=False)
    }
    read = pd.DataFrame(
        {x: {kind: published.value(f"fault_free.{kind}.{x:g}") for kind in KINDS} for x in SCALES}
    )
    modelled, noisy = settings[MODELLED], settings[NOISE]
    slope, band = growth(read.loc["mean"])["slope"], published.band("a6.mean")
    readings = (
        (words, *_by_scale(modelled[of]), _with_interval(over_kinds(modelled[of].mean(axis=1))))
        for of, words in WORDS["readings"].items()
    )
    shown = modelled[["peak_mm", "mean_mm"]].map("{:.2f}".format)
    pulses = modelled["pulses"].sum(axis=1)
    motions = (
        (f"{kind} {seed}", *errors, int(count))
        for (kind, seed), errors, count in zip(shown.index, shown.to_numpy(), pulses, strict=True)
    )
    return study.Findings(
        tuple(_lines(modelled, noisy["pulses"] > 0, read, published)),
        (
            read_table(NAME, "dependences", _dependences(settings, band), slope=slope),
            read_table(NAME, "readings", readings),
            read_table(NAME, "motions", motions),
        ),
        study.read_notes(NAME),
    )


def _measured(context: study.Context) -> pd.DataFrame:
    """Return each segment, with its setting and the kind and seed of its motion."""
    recorder, parts = Recorder(), []
    for name, setting in settings_of(VARIANTS):
        if name in context.folders:
            frame = pd.DataFrame(recorder.measure(context.folders[name], segment)).assign(**setting)
            if setting["setting"] == MODELLED:
                frame["setting"] = frame["group"]
            parts.append(frame.drop(columns="group"))
    return pd.concat(parts)


def _lines(
    modelled: pd.DataFrame, noisy_cue: pd.DataFrame, read: pd.DataFrame, published: Published
) -> Iterator[Line]:
    """Yield the lines. `noisy_cue`: whether a cue comes in a segment with noise, by motion and
    scale. `read`: published tip errors by kind and scale.
    """
    yield Line(
        "mean tip error of all segments",
        "mm",
        StudyEstimate(float(read.loc["mean"].mean()), of="mean of four readings of Figure 3"),
        over_kinds(modelled["mean_mm"].mean(axis=1)),
        published.band("a6.mean"),
        "A6",
        "the nominal model's gains, the latency of packets and the motion are not published",
    )
    offset = modelled["rest_mm"].iloc[0, 0]
    reasons = {"at_zero": f"the model starts at the true tip, {offset:.2f} mm off the reported tip"}
    for of, words in WORDS["line"].items():
        for kind, readings in read.iterrows():
            figure = StudyEstimate(float(growth(readings)[of]), of="four readings of Figure 3")
            lines = modelled[f"{kind}_mm"].apply(growth, axis=1)[of]
            mean, quantity = over_kinds(lines), words.format(kind)
            if of == "explained":
                over = f"{mean.of}, smallest to largest of a motion"
                mean = dataclasses.replace(mean, low=lines.min(), high=lines.max(), of=over)
                band = published.band("a6.explained")
                yield Line(quantity, "", figure, mean, band, "A6", WORDS["curved"][kind])
            else:
                yield Line(quantity, "mm", figure, mean, reason=reasons.get(of, ""))
    scales = ", ".join(f"{scale:g}" for scale in noisy_cue if noisy_cue[scale].any()) or "none"
    yield Line(
        "fault-free segments with noise and a cue",
        "",
        published.estimate("fault_free.segments_over_threshold"),
        StudyEstimate(int(noisy_cue.sum(axis=None)), n=noisy_cue.size, of="segments with noise"),
        reason=f"scales with a cue: {scales}; without noise {_cues(modelled)} segments have a cue",
    )
    for kind in read.index:
        for scale, values in modelled[f"{kind}_mm"].items():
            figure = published.estimate(f"fault_free.{kind}.{scale:g}")
            yield Line(f"{kind} tip error, scale {scale:g}", "mm", figure, over_kinds(values))


def _dependences(
    settings: Mapping[str, pd.DataFrame], band: tuple[float, float]
) -> Iterator[tuple[str, ...]]:
    modelled = settings[MODELLED]["mean_mm"].mean(axis=1)
    for name, setting in settings.items():
        means, lines = setting["mean_mm"].mean(axis=1), setting["mean_mm"].apply(growth, axis=1)
        change, mean = over_kinds(means - modelled[means.index]), over_kinds(means)
        yield (
            name,
            *_by_scale(setting["peak_mm"]),
            _with_interval(mean),
            "yes" if band[0] <= mean.value <= band[1] else "no",
            "–" if name == MODELLED else _with_interval(change, "+"),
            f"{over_kinds(lines['slope']).value:.1f}",
            f"{over_kinds(lines['explained']).value:.2f}",
            _cues(setting),
            f"{(setting['stop_ms'] >= 0).sum(axis=None)}",
        )


def _by_scale(values: pd.DataFrame) -> list[str]:
    """Write the mean over kinds of motion at each scale."""
    return [f"{over_kinds(at_scale).value:.2f}" for _, at_scale in values.items()]


def _with_interval(mean: StudyEstimate, sign: str = "") -> str:
    value, low, high = (f"{end:{sign}.2f}" for end in (mean.value, mean.low, mean.high))
    return value if np.isnan(mean.low) else f"{value} ({low} to {high})"


def _cues(setting: pd.DataFrame) -> str:
    """Write how many segments have a cue: `17 of 36`."""
    pulses = setting["pulses"]
    return f"{(pulses > 0).sum(axis=None)} of {pulses.size}"


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)

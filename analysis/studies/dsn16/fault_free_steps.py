"""What the steps of fault-free runs say in sentences; every number of them is of the runs or of
the publication.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.dsn16.detector import JOINTS, VARIABLES, Learned
from studies.framework.literature import Published
from studies.framework.study import StudyEstimate

BASELINE = "suture"
NAMES = {"mpos": "motor position", "mvel": "motor velocity", "jpos": "joint position"}
MOTORS = VARIABLES[:2]
"""Variables whose steps were published."""

SUBSTEPS = {"one": BASELINE, "four": "substeps_4", "ten": "substeps_10"}
"""Plant steps a millisecond, and the variant that has them."""


def deviation(values: np.ndarray) -> StudyEstimate:
    """Standard deviation about 0 of steps [runs, rows], with its range over runs; steps have no
    mean to speak of.
    """
    by_run = np.sqrt(np.mean(np.square(values, dtype=float), axis=1))
    return StudyEstimate(
        float(np.sqrt(np.mean(by_run**2))),
        float(by_run.min()),
        float(by_run.max()),
        len(by_run),
        "runs",
    )


def notes(learned: Mapping[str, Learned], both: Learned, published: Published) -> tuple[str, ...]:
    """learned: of each variant; both: of the two motions from which thresholds are learned."""
    return tuple(
        filter(None, (_sizes(learned, both, published), _integrator(learned), _build(learned)))
    )


def _deviations(one: Learned) -> np.ndarray:
    """[2, 3] of motor position and velocity, by joint."""
    return np.array(
        [[deviation(one.pooled[:, :, v, j]).value for j in range(3)] for v in range(len(MOTORS))]
    )


def _sizes(learned: Mapping[str, Learned], both: Learned, published: Published) -> str:
    spread = np.array(
        [[published.value(f"step.{name}.{joint}") for joint in JOINTS] for name in MOTORS]
    )
    base = _deviations(learned[BASELINE])
    others = [
        _deviations(one) / base
        for name, one in learned.items()
        if name in ("peg_transfer", "palpate", "reach")
    ]
    motions = (
        f"; other motions have {_range(np.array(others))} times those of the baseline"
        if others
        else ""
    )
    text = both.percentile_of_maxima(99.9) / both.percentile(99.9)
    largest = [
        published.value(f"largest.{key}") / published.value(f"step.{key}")
        for key in ("mpos.shoulder", "mvel.shoulder")
    ]
    return (
        f"Standard deviations of steps are {_range(base / spread)} times the published ones, joint"
        f" by joint{motions}. The published trajectories are not at hand, so no threshold here is"
        f" that of the publication. The text's thresholds are {_range(text)} times the code's at"
        " 99.9 %, on generated hands; the largest published steps of the shoulder's motor are"
        f" {_range(np.array(largest), 0)} standard deviations."
    )


def _integrator(learned: Mapping[str, Learned]) -> str:
    velocity = {
        words: _deviations(learned[name])[1, 2]
        for words, name in SUBSTEPS.items()
        if name in learned
    }
    if len(velocity) < 2:
        return ""
    steps = ", ".join(f"{value:.3g} with {words}" for words, value in velocity.items())
    return (
        "Integrator: the standard deviation of the insertion's velocity steps is, in rad/s,"
        f" {steps} plant steps a millisecond. The plant is stepped implicitly. A rebuild with"
        " explicit Euler steps of 1 ms had 0.115 against 0.017 rad/s converged, on another"
        " trajectory."
    )


def _build(learned: Mapping[str, Learned]) -> str:
    if "build_robot" not in learned:
        return ""
    position, velocity = _deviations(learned["build_robot"]) / _deviations(learned[BASELINE])
    return (
        "With encoders of 4000 counts and the velocity filter (build_robot) steps of motor"
        f" velocity are {_range(velocity)} times as large, those of motor position"
        f" {_range(position)} times."
    )


def _range(numbers: np.ndarray, digits: int = 2) -> str:
    return f"{numbers.min():.{digits}f} to {numbers.max():.{digits}f}"

"""The promise on the robot itself, at a reduced size: calibrations drawn from operations whose
truth is known.
"""

import numpy as np
import pytest
from scipy.stats import binom

from ravenjax.analyses.monitors import calibrate
from ravenjax.analyses.monitors.monitor import WHOLE, split_scores
from ravenjax.analyses.monitors.operations import OperationDesign
from ravenjax.campaign import loading
from ravenjax.stats.conformal import shift, threshold
from ravenjax.stats.conformal.threshold import FalseAlarmTarget, OperationScores

ROBOTS, LENGTH_S, UNITS, CALIBRATIONS = 4, 4.0, 60, 200
VARIED = {
    "drawn": [],
    "one": ["parameters.plant.friction_scale=1", "campaign.kinematic_errors=none"],
}


def operations(folder, name, changes, count, seed):
    config = loading.load_campaign("drawn_robots", changes)
    wanted = split_scores(calibrate.choose_candidates(config.robot, calibrate.SIGNALS))
    design = OperationDesign(calibrate.varying_motions(config), ROBOTS, LENGTH_S, seed)
    return calibrate.simulate_operators(
        config, design, wanted, WHOLE, folder / name, count, "simd", lambda *_: None
    )


def joint(peaks, scale):
    return peaks._replace(score=threshold.joint_scores(peaks.score[:, :, None], scale))


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIED)
def test_calibrations_keep_the_risk_with_their_confidence(tmp_path, name):
    peaks = operations(tmp_path, name, VARIED[name], 150, 1)
    learns = peaks.unit < 20
    scale = threshold.signal_scales(peaks.score[learns][:, :, None])
    population = joint(peaks.taken_from(peaks.unit[~learns]), scale)
    target, rng, broken, naive = (
        FalseAlarmTarget(80.0, 0.9, LENGTH_S / 3600),
        np.random.default_rng(2),
        0,
        0,
    )
    rows = np.arange(len(population.unit)).reshape(-1, ROBOTS)

    def risk(limit):
        return np.where(
            population.score > limit, 1.0, target.without_alarm(population.hours)
        ).mean()

    for _ in range(CALIBRATIONS):
        some = rows[rng.integers(len(rows), size=UNITS)].ravel()
        own = OperationScores(
            np.repeat(np.arange(UNITS), ROBOTS), population.score[some], population.hours[some]
        )
        broken += risk(threshold.smallest_threshold(own, target).value) > target.risk
        # the plain quantile of all scores, as if every operation were a unit
        naive += risk(np.quantile(own.score, 1.0 - target.risk, method="higher")) > target.risk
    assert broken <= binom.ppf(0.999, CALIBRATIONS, 0.1) < naive


@pytest.mark.slow
def test_a_robot_with_other_friction_is_a_shift(tmp_path):
    first = slice(None, None, ROBOTS)  # of each operator
    same = operations(tmp_path, "same", [], 80, 1)
    worn = operations(tmp_path, "worn", ["parameters.plant.friction_scale=5"], 20, 2)
    scale = threshold.signal_scales(same.score[: 10 * ROBOTS][:, :, None])
    own = joint(same, scale).score[first][10:]
    assert shift.test_shift(own[:50], own[50:]).p > 0.001
    tip = -1  # the last term: the distance from the nominal model
    assert shift.test_shift(same.score[first, tip][10:], worn.score[first, tip]).p < 0.01

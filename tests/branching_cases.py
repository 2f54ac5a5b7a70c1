"""Plans of any fault, and what their runs become: going on from their golden runs, and whole."""

import dataclasses

import numpy as np
import pandas as pd

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.faults.table import ARRAYS, FOREVER_TICKS
from ravenjax.numbers.setup import Injection, SiteUse
from ravenjax.robots.raven2 import ROBOT
from ravenjax.vocabulary.effects import EFFECT_CODES, NETWORK_EFFECTS, TRIGGER_CODES

TICKS, RUNS, OBSERVE = 600, 96, 60
EFFECTS = [name for name in EFFECT_CODES if name not in NETWORK_EFFECTS]
GAIN = "control.motor_control.gold.kp.shoulder"
SCALES = (0.0, 1.0, -0.3, 3.0, 40.0, -500.0, 2e4)


def plain():
    config = rj.load_campaign(
        {
            "campaign": {"name": "plain", "duration_s": TICKS / 1000},
            "operator": {"motion": "suture", "seed": 1},
            "group": [{"name": "g", "parameters": {"plant.cable_stiffness_scale": [1.0]}}],
        }
    )
    return plan.make_plan(config)


def with_every_fault(ready):
    """The plan's program with two slots for any effect at two channels of any site, by any
    trigger.
    """
    sites = []
    for site in ROBOT.sites.values():
        # The channels of site `parameter` are paths.
        names = [channel.name for channel in site.channels] or [GAIN]
        channels = dict.fromkeys((names[0], names[-1]))
        arm = "gold" if site.per_arm else ""
        of_site = ("overwrite", "toggle") if site.name == "buttons" else tuple(EFFECTS)
        sites.append(SiteUse(site.name, tuple((arm, name) for name in channels), of_site))
    injection = Injection(2, tuple(sites), tuple(TRIGGER_CODES))
    setup = dataclasses.replace(ready.program.setup, injection=injection)
    return dataclasses.replace(ready, program=dataclasses.replace(ready.program, setup=setup))


def drawn(ready, seed):
    """Runs of three golden runs, with any faults."""
    rng, shape = np.random.default_rng(seed), (RUNS, 2)
    codes = sum(len(use.channels) for use in ready.program.setup.injection.sites)
    faults = {
        "code": rng.integers(1, codes + 1, shape) * (rng.random(shape) < 0.8),
        "effect": rng.choice([EFFECT_CODES[name] for name in EFFECTS], shape),
        "trigger": rng.choice(list(TRIGGER_CODES.values()), shape),
        "value": rng.choice(SCALES, shape),
        "start": (
            rng.choice([0, 1, 2, 30, 200, 350, 500, TICKS - 1, TICKS, 2 * TICKS], shape)
            + rng.integers(0, 30, shape)
        ),
        "duration": rng.choice([1, 2, 15, 120, FOREVER_TICKS], shape),
        "every": rng.choice([0, 0, 40], shape),
        "period": rng.integers(1, 20, shape),
        "key": rng.integers(0, 2**32, shape),
    }
    golden = np.minimum(rng.integers(0, 40, RUNS), 2).astype(np.int32)
    return dataclasses.replace(
        ready,
        rows=pd.DataFrame({"run_id": np.arange(RUNS, dtype=np.uint64)}),
        faults={name: faults[name].astype(dtype) for name, dtype in ARRAYS.items()},
        varied={path: np.array([1.0, 1.5, 0.7], np.float32)[golden] for path in ready.varied},
        golden=golden,
    )


def observed(ready, observe):
    """The plan with runs that end so long after their faults."""
    campaign = ready.config.campaign.model_copy(update={"observe_ms": observe})
    config = ready.config.model_copy(update={"campaign": campaign})
    return dataclasses.replace(
        ready, config=config, program=dataclasses.replace(ready.program, ends=True)
    )


def tables(ready, engine, whole=False):
    """Columns of the runs of a plan, and of their golden runs."""
    computation = Computation(ready, engine, runs=40, threads=1, whole=whole)
    parts = list(computation.blocks([range(ready.runs)]))
    return [
        {name: np.concatenate([part[t][name] for part in parts]) for name in parts[0][t]}
        for t in (0, 1)
    ]


def require_within(ready, table):
    """Faults of whole runs change nothing before they may act first, nor after a run is no
    longer observed.
    """
    observed_until = ready.ends if ready.program.ends else np.full(ready.runs, TICKS)
    for slot in range(2):
        first, last = table[f"applied{slot}_first_ms"], table[f"applied{slot}_last_ms"]
        assert (ready.acts[first >= 0] <= first[first >= 0]).all()
        assert (last <= np.where(observed_until < TICKS, observed_until - OBSERVE - 1, TICKS)).all()


def require_same(some, others):
    for one, other in zip(some, others, strict=True):
        assert one.keys() == other.keys()
        for name, values in one.items():
            np.testing.assert_array_equal(
                values.view(np.int32), other[name].view(np.int32), err_msg=name
            )

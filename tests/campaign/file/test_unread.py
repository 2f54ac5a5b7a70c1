"""The parameters that nothing reads are those, and only those, that a campaign file is refused
for.
"""

import dataclasses

import jax
import numpy as np
import pytest
from jax.interpreters import partial_eval

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.campaign.file import bounds
from ravenjax.engines import xla as scan
from ravenjax.numbers import paths
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.campaign.program import DELAY, NOISE_KEY, PACKET_KEY, PACKETS
from ravenjax.robots.raven2.loop import run

KINDS = ("steps", "derivative_sum", "tip_error", "overdrive")
LANES = 2


def without_influence(ready: plan.Plan) -> set[str]:
    """Full paths of parameters that no state, outcome or series of a tick depends on."""
    leaves = dict(paths.path_leaves(ready.program.params, ready.program.setup))
    names = tuple(path for path in leaves if not path.startswith("start."))
    varied = [np.full(LANES, leaves[name]) for name in names]
    program = dataclasses.replace(ready.program, varied=names)
    segment = scan._segment_function(program, 1, False)
    reference = np.zeros((1, run.series_length(program.setup), LANES), np.float32)
    motion = tuple(np.asarray(column) for column in ready.columns)
    faults = ready.lanes([0], LANES)[1]
    state = jax.eval_shape(jax.vmap(program.begin), varied)
    traced = jax.make_jaxpr(segment)(varied, faults, (), state, np.int32(1), reference, motion)
    _, used = partial_eval.dce_jaxpr(traced.jaxpr, [True] * len(traced.jaxpr.outvars))
    return {path for path, read in zip(names, used, strict=False) if not read}


@pytest.mark.slow
@pytest.mark.parametrize(
    "campaign",
    [
        {},
        {"noise": True, "console": "absolute"},
        {"packets": "bursts"},
        {"parameter_set": "power_consistent"},
        {"parameter_set": "power_consistent", "cables": "break"},
        {"software": "fork2015"},
        {"software": "fork2015", "build": "dyn_sim", "console": "absolute"},
    ],
)
def test_what_nothing_reads_is_refused(campaign):
    config = rj.load_campaign(
        {
            "campaign": {"name": "x", "duration_s": 0.01, **campaign},
            "reaction": {},
            "hand": {},
            "detector": [{"name": kind, "kind": kind} for kind in KINDS],
            "group": [{"name": "a"}],
        }
    )
    ready = plan.make_plan(config)
    components = {"control.overdrive.dac_max.grasp2"}
    refused = {
        path
        for path, quantity in bounds.parameter_bounds(ROBOT)
        if quantity.read_when
        and getattr(config.campaign, quantity.read_when[0]) != quantity.read_when[1]
    }
    silent = {NOISE_KEY, *ROBOT.noise} if not config.campaign.noise else set()
    idle = without_influence(ready) - {DELAY, PACKETS}  # which are read where they are varied
    silent |= {"network.cycles_per_packet"} if config.random_packets else {PACKET_KEY}
    assert {bounds.shorten_path(ROBOT, path) for path in idle - components} == refused | silent
    assert components <= idle

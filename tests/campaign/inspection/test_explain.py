"""Explained runs against two whole traces of each, compared offline; and that explaining changes
no run.
"""

import dataclasses

import numpy as np
import pytest
import tiny_campaign

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.campaign.inspection.explain import Explainer
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError
from ravenjax.faults.injection import read_channel
from ravenjax.numbers.vec import Vec
from ravenjax.report.run.chain import list_signals as signals_of
from ravenjax.robots.raven2.declaration import ROBOT, SEAMS, SITES
from ravenjax.robots.raven2.geometry.mapping import quat_from_matrix
from ravenjax.robots.raven2.loop import run
from ravenjax.stages.explained import explain_program
from ravenjax.vocabulary.seams import list_crossings
from ravenjax.vocabulary.sites import ARM

NO_SITE = {
    "network",
    "checked_cmd",
    "boards",
    "motor_mpos",
    "motor_mvel",
    "cable_tension",
    "link_jpos",
    "link_jvel",
    "tip",
}
"""Seams that are no fault site."""


def sites_of(signals):
    """Site -> its signal, as the sites' own paths read it."""
    arms, control = signals.control.arms, signals.control
    of = {
        name: [getattr(arm, name) for arm in arms]
        for name in ("mpos", "mvel", "jpos", "jvel", "jpos_d", "mpos_d", "tau_d", "current_cmd")
    }
    poses = {name: [getattr(arm, name) for arm in arms] for name in ("pos", "pos_d")}
    return of | {
        "packet": control.packet,
        "packet_header": control.packet,
        "usb_in": dataclasses.make_dataclass("UsbWords", ["enc_val"])(
            [arm.enc_val for arm in arms]
        ),
        "encoder": [out.enc_val for out in signals.plant],
        "runlevel": control.runlevel,
        "pos": [pose.position_um for pose in poses["pos"]],
        "pos_d": [pose.position_um for pose in poses["pos_d"]],
        "ori": [quat_from_matrix(Vec(map(Vec, pose.rotation))) for pose in poses["pos"]],
        "ori_d": [quat_from_matrix(Vec(map(Vec, pose.rotation))) for pose in poses["pos_d"]],
        "usb_out": [arm.current_cmd_written for arm in arms],
        "pins_out": control.pins_out,
        "plc": signals.plc.runlevel,
        "brake": signals.plc.brakes,
    }


def others_of(signals, seam, arm):
    """Numbers of a seam that is no fault site, by channel."""
    if seam == "network":
        return {"received": signals.packet.received, "sequence": signals.packet.sequence}
    joints = [channel.name for channel in SEAMS["mpos"].channels]
    field = {"motor_mpos": "mpos", "motor_mvel": "mvel", "cable_tension": "tension"}
    field |= {"link_jpos": "jpos", "link_jvel": "jvel"}
    if seam == "checked_cmd":
        return dict(zip(joints, signals.control.arms[arm].current_cmd_checked, strict=True))
    if seam == "boards":
        return dict(zip(joints, signals.boards[arm], strict=True))
    if seam == "tip":
        return dict(zip("xyz", signals.tip[arm], strict=True))
    return dict(zip(joints, getattr(signals.plant[arm], field[seam]), strict=True))


def series(signals, arms):
    """Name of a crossing -> its number in each tick, [ticks]."""
    found, out = sites_of(signals), {}
    for place in list_crossings(SEAMS, arms):
        seam, arm = place.seam.name, arms.index(place.arm) if place.arm else 0
        if seam in NO_SITE:
            values = others_of(signals, seam, arm)[place.channel.name]
        elif place.channel.name in ("soft_estopped", "pedal"):
            name = {"pedal": "surgeon_mode"}.get(place.channel.name, place.channel.name)
            values = getattr(signals.control, name)
        elif seam in ("ori", "ori_d") and place.channel.name.startswith("r"):
            pose = getattr(signals.control.arms[arm], {"ori": "pos", "ori_d": "pos_d"}[seam])
            row, column = (int(digit) - 1 for digit in place.channel.name[1:])
            values = pose.rotation[row][column]
        else:
            path = SITES[seam].channel(place.channel.name).path
            values = read_channel(found[seam], tuple(arm if step == ARM else step for step in path))
        out[place.name] = np.asarray(values)
    return out


def first(happens):
    return int(np.argmax(happens)) if happens.any() else -1


def bits(values):
    values = np.ascontiguousarray(values)
    return values.view(np.int32) if values.dtype == np.float32 else values.astype(np.int64)


def offline(signals, golden, arms):
    """Name of a crossing -> (differs, leaves), from two whole traces."""
    own, usual = series(signals, arms), series(golden, arms)
    received = np.asarray(signals.control.packet.received) != 0
    out = {}
    for place in list_crossings(SEAMS, arms):
        there = (
            received
            if place.seam.name in ("packet", "packet_header")
            else np.ones(len(received), bool)
        )
        differs = first((bits(own[place.name]) != bits(usual[place.name])) & there)
        leaves = -1
        if place.channel.site:
            span = ROBOT.normal_range(place.channel.site, place.channel.name, place.arm)
            low, high = (
                np.float32(end)
                for end in (span.low - 5e-6 * abs(span.low), span.high + 5e-6 * abs(span.high))
            )
            inside = [
                (x.astype(np.float32) >= low) & (x.astype(np.float32) <= high)
                for x in (own[place.name], usual[place.name])
            ]
            leaves = first(~inside[0] & inside[1] & there)
        out[place.name] = (differs, leaves)
    return out


def traces(config, rows):
    """(signals, golden run's signals) of each row: whole traces by the ordinary tick."""
    ready = plan.make_plan(config)
    program = dataclasses.replace(explain_program(ready.program, config.robot), module=run.__name__)
    tracer = selection.select_engine("simd").tracer(program, 1)
    for row in rows:
        ends = np.full(1, int(ready.ends[row]))
        harmless, faulty = (
            Block(*ready.lanes([row], 1, harmless=one), None, ends=ends) for one in (True, False)
        )
        golden = tracer.run(harmless, harmless, ready.columns)[2]
        yield tracer.run(harmless, faulty, ready.columns)[2], golden


def require_equal_to_traces(config, rows, engine="simd"):
    """Every number of every row, to the tick."""
    explained = Explainer(config, engine).explain(rows)
    arms = config.campaign.arms
    for place, (signals, golden) in enumerate(traces(config, rows)):
        expected = offline(signals, golden, arms)
        row = explained.ticks.iloc[place]
        for name, (differs, leaves) in expected.items():
            if not (
                name.split("/")[-2] in ("ori", "ori_d") and "/q" in name
            ):  # of a matrix whose bits are compared
                assert row[f"differs:{name}"] == differs, (rows[place], name)
            if f"leaves:{name}" in row:
                assert row[f"leaves:{name}"] == leaves, (rows[place], name)
            else:
                assert leaves == -1
        for one in signals_of({key: [value] for key, value in row.items()}, config.robot, arms):
            firsts = [
                t for name, (t, _) in expected.items() if name.startswith(one.name + "/") and t >= 0
            ]
            assert one.differs[0] == min(firsts, default=-1), (rows[place], one.name)
    return explained


def spread(config, runs):
    """Rows over all sites, as many of each as there are, `runs` in all."""
    table = plan.make_plan(config).rows
    by_site = [
        group.index.to_numpy()
        for site, group in table.groupby("fault0_site", observed=True)
        if site
    ]
    # No bundled campaign changes a parameter.
    assert len(by_site) == len(SITES) - 1
    each = -(-runs // len(by_site))
    rows = np.concatenate(
        [some[np.linspace(0, len(some) - 1, min(each, len(some))).astype(int)] for some in by_site]
    )
    return np.unique(rows)


BOTH = {
    "campaign": {"name": "both", "duration_s": 0.4, "arms": ["gold", "green"]},
    "operator": {"motion": "reach"},
    "group": [
        {
            "name": site,
            "parameters": {"plant.friction_scale": [1.0, 1.3]},
            "fault": [
                {
                    "site": site,
                    "arm": ["gold", "green"],
                    "start_ms": 250,
                    "duration_ms": 60,
                    **fault,
                }
            ],
        }
        for site, fault in {
            "usb_out": {"channel": "elbow", "effect": "overwrite", "value": 9000},
            "packet": {"channel": "delx", "effect": "offset", "value": 400},
            "ori_d": {"channel": "qx", "effect": "offset", "value": 0.02},
            "mpos": {"channel": "shoulder", "effect": "offset", "value": 0.001},
        }.items()
    ],
}


@pytest.mark.slow
def test_explained_runs_are_what_two_whole_traces_say():
    config = rj.load_campaign(BOTH)
    explained = require_equal_to_traces(config, np.arange(0, 16, 3))
    differs = explained.ticks.filter(like="differs:")
    assert (differs.to_numpy().max(axis=1) >= 250).all()
    assert (explained.ticks.filter(like="leaves:").to_numpy() >= 0).any()


@pytest.mark.parametrize("engine", ["mjx", "simdd", "cpu"])
def test_an_engine_that_cannot_is_named(engine):
    with pytest.raises(
        UserError, match=f"engine '{engine}' cannot explain runs: expected auto or cuda, simd, xla"
    ):
        Explainer(tiny_campaign.config(runs=5), engine)


@pytest.mark.slow
def test_two_hundred_runs_over_all_sites_are_what_two_whole_traces_say():
    config = rj.load_campaign("quick")
    rows = spread(config, 200)
    assert len(rows) >= 200
    require_equal_to_traces(config, rows)

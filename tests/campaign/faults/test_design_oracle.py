"""The fault table by columns is the one written out row by row, whatever the campaign."""

import naive_design
import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design, sampling
from ravenjax.campaign.stop.adaptive import group_draws
from ravenjax.errors import UserError
from ravenjax.hazards import library

CHANNELS = {
    "usb_out": ("shoulder", "elbow", "wrist"),
    "packet": ("delx", "qw", "grasp"),
    "tau_d": ("elbow", "insertion"),
    "usb_status": ("read_ok", "write_ok"),
    "console": ("scale",),
    "brake": ("engaged",),
    "network": ("lag", "delay", "lost"),
}
EFFECTS = (
    "overwrite",
    "offset",
    "scale",
    "stuck",
    "bit_flip",
    "periodic",
    "toggle",
    "drift",
    "random",
)
NETWORK = ("drop", "duplicate", "delay", "overwrite")
numbers = st.one_of(st.integers(-9, 9), st.sampled_from([-0.0, 0.0, 0.5, 1.0, 1, 0, 3e4, 2**31]))
times = st.integers(1, 300)


def axis(values, ends=None, length=None):
    """An axis of these values: one, a list of them (of a length, if given), or a distribution
    between `ends`.
    """
    several = st.lists(values, min_size=length or 1, max_size=length or 3)
    kinds = [values, several, several.map(lambda v: {"choice": v})]
    if ends is not None:
        pairs = st.lists(ends, min_size=2, max_size=2).map(sorted)
        kinds += [
            pairs.map(lambda p: {"uniform": p}),
            pairs.map(lambda p: {"loguniform": sorted(abs(x) + 0.5 for x in p)}),
        ]
        kinds += [pairs.map(lambda p: {"normal": [p[0], abs(p[1])]})]
    return st.one_of(kinds)


@st.composite
def faults(draw, length):
    site = draw(st.sampled_from(list(CHANNELS)))
    fault = {"site": site, "start_ms": draw(axis(times, times, length))}
    fault["effect"] = draw(
        axis(st.sampled_from(NETWORK if site == "network" else EFFECTS), None, length)
    )
    fault["channel"] = draw(
        st.one_of(st.just("*"), axis(st.sampled_from(CHANNELS[site]), None, length))
    )
    fault["value"] = draw(axis(numbers, st.integers(-40, 40), length))
    if site in ("usb_out", "packet", "tau_d", "usb_status"):
        fault["arm"] = draw(axis(st.sampled_from(["gold", "green"]), None, length))
    more = {
        "duration_ms": axis(st.one_of(times, st.just("end")), times, length),
        "period_ms": axis(times, times, length),
        "trigger": axis(st.sampled_from(["time", "pedal", "packet"]), None, length),
    }
    return fault | {name: draw(values) for name, values in more.items() if draw(st.booleans())}


CROSS = st.dictionaries(
    st.sampled_from(["plant.mass_scale", "operator.scale"]),
    st.lists(st.sampled_from([0.5, 1, 0.25]), min_size=1),
)


@st.composite
def groups(draw, name):
    kind = draw(st.sampled_from(["grid", "zip", "list", "random", "lhs", "sobol"]))
    length = 3 if kind == "zip" else None
    group = {"name": name, "design": kind, "repeats": draw(st.integers(1, 3))}
    group["fault"] = draw(st.lists(faults(length), max_size=2))
    paths = draw(st.lists(st.sampled_from(["plant.friction_scale", "operator.scale"]), unique=True))
    group["parameters"] = {
        path: draw(axis(st.sampled_from([0.5, 1, 0.25]), None, length)) for path in paths
    }
    if kind == "list":
        entry = st.fixed_dictionaries(
            {"value": st.integers(0, 1)},
            optional={"duration_ms": times, "trigger": st.just("time")},
        )
        fault = st.lists(entry, max_size=len(group["fault"]))
        scale = st.dictionaries(st.just("plant.friction_scale"), st.sampled_from([0.5, 2]))
        group["run"] = draw(
            st.lists(
                st.fixed_dictionaries({"fault": fault, "parameters": scale}), min_size=1, max_size=3
            )
        )
    group["cross"] = draw(CROSS)
    if kind in ("random", "lhs", "sobol"):
        group["runs"] = draw(st.integers(1, 9))
    return group


HAZARDS = [row.id for row in library.all_hazards() if row.runnable]


@st.composite
def hazards(draw, name):
    """A group that names rows of the library instead of faults of its own."""
    group = {
        "name": name,
        "hazards": draw(st.lists(st.sampled_from(HAZARDS), min_size=1, max_size=2)),
        "arm": "gold",
    }
    if draw(st.booleans()):
        group["start_ms"] = draw(times)
    return group | {"repeats": draw(st.integers(1, 2))}


SECTIONS = {
    "cross": CROSS,
    "parameters": st.dictionaries(st.just("operator.scale"), st.sampled_from([0.5, 1])),
    "reaction": st.fixed_dictionaries({"action": st.sampled_from(["none", "release", "slow"])}),
    "detector": st.just(
        [{"name": "d", "kind": "steps", "fusion": ["all", "any"], "threshold": [1, 2]}]
    ),
}


@st.composite
def campaigns(draw):
    campaign = {
        "name": "x",
        "noise": True,
        "arms": ["gold", "green"],
        "seed": draw(st.integers(0, 2**31 - 1)),
    }
    last = draw(st.sampled_from(["limit", "stop", None]))
    if last == "limit":
        campaign["limit"] = draw(st.integers(1, 20))
    if draw(st.booleans()):
        campaign["dac_words"] = draw(st.sampled_from(["wrap", "saturate", "unwrapped"]))
    found = {"campaign": campaign, "operator": {"motion": "still"}}
    found |= {name: draw(values) for name, values in SECTIONS.items() if draw(st.booleans())}
    if last == "stop":
        found["stop"] = {
            "half_width": 0.1,
            "allocation": draw(st.sampled_from(["proportional", "neyman"])),
        }
    kinds = [
        draw(st.sampled_from([groups, groups, groups, hazards]))
        for _ in range(draw(st.integers(1, 3)))
    ]
    return found | {"group": [draw(kind(name)) for kind, name in zip(kinds, "abc", strict=False)]}


FAULT = {"site": "usb_out", "arm": "gold", "channel": "elbow", "effect": "overwrite", "start_ms": 5}


@pytest.mark.slow
@settings(max_examples=150)
@given(campaigns())
@example(
    {
        "campaign": {"name": "x"},
        "group": [{"name": "a", "fault": [FAULT | {"value": [1.0, 1, -0.0, 0, 1.5]}]}],
    }
)
@example(
    {
        "campaign": {"name": "x"},
        "group": [{"name": n, "repeats": 1, "fault": [FAULT | {"value": [7, 7]}]} for n in "ab"],
    }
)
def test_columns_are_those_written_out_row_by_row(campaign):
    """Also where some runs are alike."""
    try:
        config = loading.from_dict(campaign)
    except UserError:
        assume(False)
    try:
        rows = naive_design.expand(config)
    except UserError as wrong:
        assert complaint(config) == str(wrong)
        return
    except ValueError:
        assert "lists of one length" in complaint(config)
        return
    table = design.table_columns(config)
    naive = pd.DataFrame(rows)
    assert list(table.columns) == list(naive.columns)
    for name in table.columns:
        if isinstance(table[name].dtype, pd.CategoricalDtype):
            assert table[name].tolist() == naive[name].tolist(), name
            assert set(table[name].cat.categories) == set(naive[name]), (
                "no word that does not occur"
            )
        else:
            np.testing.assert_array_equal(
                table[name].to_numpy(), naive[name].to_numpy(table[name].dtype), name
            )
    assert table["run_id"].is_unique
    assert design.count_rows(config) == len(table)
    if config.stop is not None:
        beginnings(config, table)


def beginnings(config, table):
    """Of a campaign that may stop, the beginning of each group's rows is so many whole draws of
    that group.
    """
    draws = group_draws(config)
    assert [of.first for of in draws] == [
        (table["group"] == group.name).argmax() for group in config.group
    ]
    plain = design.table_columns(config.model_copy(update={"stop": None}))
    assert sorted(table["run_id"]) == sorted(plain["run_id"]), "the order decides no run"
    for group, of in zip(config.group, draws, strict=True):
        assert of.number * of.rows == (table["group"] == group.name).sum()
        for taken in {1, of.number // 2, of.number}:
            rows = table.iloc[list(of.rows_of(taken))]
            assert set(rows["pair"]) <= set(rows["index"]), "crossed variants are taken together"
            assert (rows.groupby("pair").size() == of.rows // group.repeats).all()
            assert (rows["seed"].value_counts() == len(rows) // group.repeats).all(), (
                "and so are repeats"
            )


def complaint(config):
    try:
        design.table_columns(config)
    except UserError as error:
        return str(error)
    return "none"


@pytest.mark.parametrize("design", ["lhs", "sobol"])
@pytest.mark.parametrize(("rows", "dimensions"), [(1, 1), (2, 3), (1000, 32), (7, 33)])
def test_points_are_those_of_scipy(design, rows, dimensions):
    ours, theirs = (np.random.default_rng(5) for _ in range(2))
    expected = naive_design.unit(design, rows, dimensions, theirs)
    np.testing.assert_array_equal(sampling._draw_points(design, rows, dimensions, ours), expected)
    assert ours.spawn(1)[0].random() == theirs.spawn(1)[0].random()

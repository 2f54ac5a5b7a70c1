"""Draws random campaigns with extreme but allowed values, and checks properties that every run must
have.

A random seed determines one campaign: software, build, mechanics, console, packets, detectors and
operator. The groups of the campaign have faults at any site, with any effect and the largest
allowed values, and parameters at the ends of their ranges. A campaign file could contain everything
that is drawn.

Engine `xla` compiles a campaign once for all values of its runs. The compile time grows with the
number of sites. The function `form` therefore distributes all sites and parameters over campaigns
with few sites.
"""

import dataclasses
import functools
import random
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np
import pandas as pd

from ravenjax.campaign import loading, plan
from ravenjax.campaign.executors.protocol import FinishedChunk, Local, Work
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress import Progress
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.numbers import paths
from ravenjax.numbers.quantity import Quantity
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.store import parts, schema
from ravenjax.vocabulary import legal
from ravenjax.vocabulary.detectors import MEANINGS
from ravenjax.vocabulary.effects import EFFECTS, NETWORK_EFFECTS, TRIGGERS
from ravenjax.vocabulary.sites import Channel, Site

DURATION_S = 0.5
LATEST_MS = 160
"""Latest onset: before the run's last packet, if packets last long."""
RUNS, FORM_RUNS = 20, 67
"""Runs per group, of `campaign` and of `form`."""
FORMS = 15
"""Campaigns of `form` that together cover all sites and parameters."""
SITES = tuple(site for site in ROBOT.sites.values() if site.channels)
"""Sites of signals. The channels of the site `parameter` depend on the campaign."""
LARGE = (0.0, 1.0, -1.0, 1e-30, 0.01, -0.3, 30.0, -1e3, 1e6, -1e9, 3e38, -3e38)
"""Values for numbers without bounds."""
WORDS = ("activated", "response", "hazard", "verdict", "failed")
"""Columns in which two engines must agree."""


def campaign(number: int, groups: int) -> CampaignConfig:
    """Return the campaign of that number, with `groups` groups of `RUNS` runs, at any sites."""
    draw = random.Random(number)
    rows = _parameters()
    draw.shuffle(rows)
    return _campaign(draw, number, groups, RUNS, list(SITES), rows)


def form(number: int, groups: int) -> CampaignConfig:
    """Return a campaign at two sites. Any `FORMS` consecutive numbers cover each site and each
    parameter.

    A parameter that the drawn software or build lacks is left out of its form, and another one
    replaces it.
    """
    turn, place = divmod(number, FORMS)
    shared = random.Random(f"turn {turn}")
    sites, rows = list(SITES), _parameters()
    shared.shuffle(sites)
    shared.shuffle(rows)
    first = place * len(rows) // FORMS
    return _campaign(
        random.Random(f"form {number}"),
        number,
        groups,
        FORM_RUNS,
        sites[place::FORMS],
        rows[first:] + rows[:first],
    )


def _campaign(
    draw: random.Random,
    number: int,
    groups: int,
    runs: int,
    sites: Sequence[Site],
    parameters: Sequence[tuple[str, Quantity]],
) -> CampaignConfig:
    raw = _frame(draw, number)
    while not _is_legal(
        {**raw, "group": [{"name": "free"}]}
    ):  # two of the choices exclude each other
        raw = _frame(draw, number)
    varied = _varied(draw, raw, parameters)
    rows: list[dict[str, Any]] = [{"name": "free"}]
    while len(rows) <= groups:
        group = _group(draw, f"g{len(rows)}", raw["campaign"]["arms"], varied, sites) | {
            "runs": runs
        }
        # For example, a word of DAC counts that must not be stored unchanged.
        if _is_legal({**raw, "group": [group]}):
            rows.append(group)
    return loading.from_dict({**raw, "group": rows})


def _is_legal(raw: dict[str, Any], planned: bool = False) -> bool:
    """Return whether a campaign is accepted. `planned`: also check with the code that knows the
    existing parameters.
    """
    try:
        config = loading.from_dict(raw)
        if planned:
            plan.make_plan(config)
    except UserError:
        return False
    return True


def _frame(draw: random.Random, number: int) -> dict[str, Any]:
    """Draw the settings that all runs share."""
    software = draw.choice(("raven2", "raven2", "fork2015"))
    raw: dict[str, Any] = {
        "campaign": {
            "name": f"extremes_{number}",
            "seed": number,
            "duration_s": DURATION_S,
            "arms": draw.choice((["gold"], ["green"], ["gold", "green"])),
            "noise": draw.random() < 0.5,
            "software": software,
            "build": (
                draw.choice(("robot", "robot", "dyn_sim", "dyn_sim_tools"))
                if software != "raven2"
                else "robot"
            ),
            "dac_words": draw.choice(("wrap", "saturate", "unwrapped")),
            "console": draw.choice(("increments", "increments", "absolute")),
            "packets": draw.choice(("every_cycle", "measured", "bursts", [0.2, 0.5, 0.3])),
            "parameter_set": draw.choice((parameter_sets.DEFAULT, *get_args(parameter_sets.Name))),
            "kinematic_errors": draw.choice(("none", "measured")),
            "cables": draw.choice(("unbreakable", "break")),
            "substeps": draw.choice((1, 1, 2)),
        },
        "operator": {"motion": draw.choice(list(MOTIONS)), "scale": draw.choice((0.05, 0.1, 1.0))},
        "haptics": {
            "threshold_mm": [3, draw.choice((0.01, 10.0))],
            "cap": draw.choice((0.05, 10.0)),
        },
        "outcomes": {"cue": draw.choice((0, 1))},
    }
    if draw.random() < 0.5:
        raw["reaction"] = {
            "action": draw.choice(("release", "slow", "correct")),
            "delay_ms": draw.choice((0, 20)),
        }
    if draw.random() < 0.5:
        raw["hand"] = {
            "grip": draw.choice((0, 1)),
            "newtons_per_unit": draw.choice((3.3, 1e3, -1e3)),
        }
    if draw.random() < 0.7:
        raw["detector"] = [{"name": kind, "kind": kind, "consecutive": [1, 8]} for kind in MEANINGS]
    return raw


MOST_PARAMETERS = 12
"""Largest number of parameters that vary in a campaign, because all runs carry each of them."""


def _parameters() -> list[tuple[str, Quantity]]:
    """Return all parameters of the robot."""
    return [
        row for row in bounds.parameter_bounds(ROBOT) if not row[0].startswith("contact.")
    ]  # these campaigns have no contact


def _varied(
    draw: random.Random, raw: dict[str, Any], parameters: Sequence[tuple[str, Quantity]]
) -> list[tuple[str, Quantity]]:
    """Return the parameters that vary in this campaign: the first of `parameters` that it has."""
    varied: list[tuple[str, Quantity]] = []
    for path, quantity in parameters:
        if len(varied) == MOST_PARAMETERS:
            break
        path = f"{path}.{draw.choice(quantity.joints)}" if quantity.joints else path
        if path.startswith(("network.", "kinematic")) or path in [name for name, _ in varied]:
            continue
        group = {"name": "g", "parameters": {path: [quantity.low, quantity.high]}}
        if _is_legal({**raw, "group": [group]}, planned=True):
            varied.append((path, quantity))
    return varied


def _group(
    draw: random.Random,
    name: str,
    arms: Sequence[str],
    varied: Sequence[tuple[str, Quantity]],
    sites: Sequence[Site],
) -> dict[str, Any]:
    """Draw runs of up to two faults, with up to three parameters at or near an end of their
    range.
    """
    parameters = {
        path: {"choice": _at_the_ends(draw, quantity)}
        for path, quantity in (
            draw.sample(varied, draw.choice((0, 1, 3))) if len(varied) > 2 else ()
        )
    }
    faults = [_fault(draw, arms, sites) for _ in range(draw.choice((1, 1, 2, 2, 0)))]
    group: dict[str, Any] = {"name": name, "design": "random", "parameters": parameters}
    return group | ({"fault": faults} if faults else {})


def _at_the_ends(draw: random.Random, quantity: Quantity) -> list[float]:
    low, high = quantity.low, quantity.high
    inside = [low + (high - low) * draw.random() for _ in range(2)]
    values = [low, high, *inside, *(x for x in (0.0, 1.0) if low <= x <= high)]
    return [float(round(x)) for x in values] if quantity.whole else values


def _fault(draw: random.Random, arms: Sequence[str], sites: Sequence[Site]) -> dict[str, Any]:
    """Draw one slot: a site, channels of one kind, an effect and the largest values that it
    takes.
    """
    site = draw.choice(sites)
    effects = [name for name in EFFECTS if name not in NETWORK_EFFECTS or site.name == "network"]
    effect = draw.choice(effects)
    first = draw.choice(site.channels)
    again = draw.random() < 0.3
    alike = [
        channel.name
        for channel in site.channels
        if (channel.kind, channel.bits) == (first.kind, first.bits)
    ]
    fault: dict[str, Any] = {
        "site": site.name,
        "effect": effect,
        "trigger": draw.choice((*TRIGGERS, "time")),
        "start_ms": {"choice": [0, 1, *(draw.randrange(LATEST_MS) for _ in range(4))]},
        "duration_ms": {"choice": [1, 3, 7] if again else [1, draw.randint(2, 100), "end"]},
        "every_ms": 7 if again else 0,
    }
    if site.per_arm:
        fault["arm"] = draw.choice(list(arms))
    if effect not in NETWORK_EFFECTS:
        fault["channel"] = draw.choice((first.name, {"choice": alike}))
    if effect == "periodic":
        fault["period_ms"] = draw.choice((1, 2, 50))
    if EFFECTS[effect].takes_value:
        fault["value"] = {"choice": _values(draw, first, effect)}
    return fault


def _values(draw: random.Random, channel: Channel, effect: str) -> list[float]:
    """Return the ends of the legal range, and some values between them."""
    _, low, high, whole, _ = legal.legal_values(channel, effect)
    values = [
        x
        for x in (low, high, *LARGE, *(draw.gauss(0.0, 100.0) for _ in range(3)))
        if low <= x <= high
    ]
    values = [float(np.float32(x)) if abs(x) < 1e38 else x for x in values if np.isfinite(x)]
    fit = [float(int(x)) if whole else x for x in values]
    return [x for x in fit if legal.find_rounding(channel, effect, x) is None and low <= x <= high]


class EngineDifference(NamedTuple):
    """A run for which two engines give different words."""

    run_id: str
    group: str
    column: str
    first: str
    second: str


def unsound(table: pd.DataFrame) -> Iterator[str]:
    """Return the errors in the rows of a result table: one line for each column with numbers that
    are not finite.
    """
    failed = (table["failed"].astype(str) != "").to_numpy()
    for name in table.columns:
        own = str(name).removeprefix(schema.GOLDEN)
        if (
            table[name].dtype.kind != "f"
            or own.startswith(("fault", "param:"))
            or own == "tip_distance_mm"
        ):
            continue
        values = table[name].to_numpy()
        invalid = np.isnan(values) if own.endswith(schema.MAY_BE_INFINITE) else ~np.isfinite(values)
        if (invalid & ~failed).any():
            rows = table.loc[invalid & ~failed]
            yield f"{name}: {len(rows)} rows of no class failed, the first {rows['run_id'].iloc[0]}"
    dated, silent = (
        (table["failed_first_ms"] >= 0).to_numpy(),
        (table["verdict"].astype(str) == "").to_numpy(),
    )
    odd = (failed != dated) | (failed != silent)
    if np.any(odd):
        yield (
            f"{np.count_nonzero(odd)} rows: a verdict although the run failed, or no tick of the"
            " failure"
        )


def differences(first: pd.DataFrame, second: pd.DataFrame) -> list[EngineDifference]:
    """Return every word in which two engines' tables of one campaign differ."""
    if list(first["run_id"]) != list(second["run_id"]):
        raise ValueError("the tables are not of the same runs")
    out = []
    for name in WORDS:
        one, other = first[name].astype(str), second[name].astype(str)
        for row in np.flatnonzero((one != other).to_numpy()):
            out.append(
                EngineDifference(
                    str(first["run_id"][row]),
                    str(first["group"][row]),
                    name,
                    str(one[row]),
                    str(other[row]),
                )
            )
    return out


NUDGES = tuple(sign * times for times in range(1, 9) for sign in (1, -1))
"""Number of last bits (ULPs) by which `nudged` moves numbers."""
NUDGED = (
    "operator.scale",
    "plant.mass_scale",
    "plant.actuators.torque_per_count",
    "nominal.mass_scale",
    "nominal.kp",
)
"""Numbers that determine almost all others of a run, in addition to its faults' values."""


def nudged(config: CampaignConfig, engine: str) -> Iterator[pd.DataFrame]:
    """Return the campaign's table once for each of `NUDGES`: `NUDGED` and the faults' values are
    moved by that many last bits.

    If a run's words change with them, last bits decide the run, and two engines need not agree on
    it.
    """
    ready = plan.make_plan(config)
    program = ready.program
    for bits in NUDGES:
        varied = dict(ready.varied)
        for path in NUDGED:
            for place, own in paths.named_numbers(program.params, program.setup, path).items():
                values = varied.get(
                    place, varied.get(path, np.full(ready.runs, own, program.setup.precision.real))
                )
                varied[place] = _moved(values, bits)
        other = dataclasses.replace(program, varied=tuple(varied))
        faults = {**ready.faults, "value": _moved(ready.faults["value"], bits)}
        yield _table(
            dataclasses.replace(ready, varied=varied, faults=faults, program=other), engine
        )


def _moved(values: np.ndarray, bits: int) -> np.ndarray:
    """Move numbers by `bits` last bits of a float32."""
    return (values * (1.0 + bits * 2.0**-23)).astype(values.dtype)


def _table(ready: plan.Plan, engine: str) -> pd.DataFrame:
    """Return what `ravenjax.run` would return."""
    backend, shape, tables = (
        selection.select_engine(engine, ready.program.setup.precision),
        ready.shape,
        {},
    )

    def deliver(done: FinishedChunk) -> None:
        tables[done.rows.start] = done.packed

    progress = Progress(engine, ready.runs, ready.runs, ready.program.ticks, None)
    pack = functools.partial(schema.conform_table, shape=shape)
    Local().run(Work(ready, backend, pack, deliver, progress), [range(ready.runs)])
    return parts.concatenate_parts([tables[first] for first in sorted(tables)])

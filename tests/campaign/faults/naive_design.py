"""The expansion of a campaign written out row by row with Python's own numbers: slow, and easy to
believe.

An oracle for `ravenjax.campaign.faults.design`, with which it shares no more than the quantiles
that a design draws.
"""

import hashlib
import itertools
import json
import math
import struct
import warnings
import zlib

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from ravenjax.campaign.file.axis import END, UNTIL_END, Axis, fixed_axis
from ravenjax.robots.raven2.declaration import SITES
from ravenjax.vocabulary.effects import NETWORK_EFFECTS
from ravenjax.vocabulary.legal import legal_values

FIELDS = (
    "site",
    "arm",
    "channel",
    "effect",
    "value",
    "trigger",
    "start_ms",
    "duration_ms",
    "every_ms",
    "period_ms",
)
EMPTY = {
    name: 0 if name.endswith("_ms") else math.nan if name == "value" else "" for name in FIELDS
}
LEAST = {"start_ms": 0, "duration_ms": 1, "every_ms": 0, "period_ms": 1}
MASK = 2**64 - 1


def expand(config):
    """Rows of the fault table as dicts; run_id an int."""
    planned = [run for group in config.group for run in runs_of(config, group)]
    paths = list(dict.fromkeys(path for _, _, parameters, _, _ in planned for path in parameters))
    common, copies, rows, repeats = common_hash(config), {}, [], []
    for index, (group, faults, parameters, repeat, behind) in enumerate(planned):
        seed = (config.campaign.seed + repeat) % 2**31
        content = {"seed": seed} | {f"param:{path}": value for path, value in parameters.items()}
        for slot, fault in enumerate(faults):
            content |= {f"fault{slot}_{name}": value for name, value in fault.items()}
        plain = mix(sum(hashed(common, name, value) for name, value in content.items()) & MASK)
        copy = copies[plain] = copies.get(plain, -1) + 1
        row = {
            "run_id": mix(plain ^ mix(copy)) if copy else plain,
            "index": index,
            "pair": index - behind,
        }
        row |= {"group": group, "seed": seed, "operator": config.operator.label}
        for slot in range(config.slots):
            fault = faults[slot] if slot < len(faults) else EMPTY
            row |= {f"fault{slot}_{name}": fault[name] for name in fault}
        rows.append(row | {f"param:{path}": parameters.get(path, math.nan) for path in paths})
        repeats.append(repeat)
    if any(behind for *_, behind in planned):
        rows = [row | {"shared_id": rows[row["pair"]]["run_id"]} for row in rows]
    return rows if config.stop is None else arranged(config, rows, repeats)


def common_hash(config):
    """What decides the outcome of every run alike."""
    content = json.dumps(config.deciding(), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(content.encode()).hexdigest()


def arranged(config, rows, repeats):
    """The rows of a campaign with [stop]: each group's draws one after another, those of lists
    in a drawn order.
    """
    out = []
    for group in config.group:
        draws, of = [], {}
        for row in (row for row in rows if row["group"] == group.name):
            if row["pair"] != row["index"]:  # a crossed variant goes with the first of its kind
                of[row["index"]] = of[row["pair"]]
            elif repeats[row["index"]]:  # a repeat goes with the one before
                of[row["index"]] = of[row["index"] - 1]
            else:
                draws.append([])
                of[row["index"]] = draws[-1]
            of[row["index"]].append(row)
        if group.design not in ("random", "lhs", "sobol"):
            rng = np.random.default_rng([config.campaign.seed, zlib.crc32(group.name.encode()), 1])
            places = rng.permutation(len(draws)).tolist()
            draws = [
                draw
                for _, draw in sorted(zip(places, draws, strict=True), key=lambda pair: pair[0])
            ]
        out += [row for draw in draws for row in draw]
    new = {row["index"]: place for place, row in enumerate(out)}
    return [row | {"index": place, "pair": new[row["pair"]]} for place, row in enumerate(out)]


def mix(x):
    """The finaliser of SplitMix64."""
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9 & MASK
    x = (x ^ (x >> 27)) * 0x94D049BB133111EB & MASK
    return x ^ (x >> 31)


def hashed(common, name, value):
    if value == "" or value != value:
        return 0
    salt = f"{common}/{name}/{value}" if isinstance(value, str) else f"{common}/{name}"
    salt = int.from_bytes(hashlib.sha256(salt.encode()).digest()[:8], "little")
    return (
        salt
        if isinstance(value, str)
        else mix(salt ^ int.from_bytes(struct.pack("<d", value + 0.0), "little"))
    )


def runs_of(config, group):
    """(group, faults, parameters, repeat, rows back to its first sibling) of each run."""
    rng = np.random.default_rng([config.campaign.seed, zlib.crc32(group.name.encode())])
    for run in group.run or (None,):
        faults = group.faults_of(run) if run else group.fault
        axes = {
            (f, name): axis
            for f, fault in enumerate(faults)
            for name, axis in axes_of(config, fault).items()
        }
        parameters = {**config.parameters, **group.parameters, **(run.parameters if run else {})}
        axes |= {("", path): axis for path, axis in parameters.items()}
        drawn = list(cells(group, axes, rng))
        crossed = {**config.cross, **group.cross}
        for number, values in enumerate(
            itertools.product(*(axis.values for axis in crossed.values()))
        ):
            for repeat, cell in drawn:
                rows = tuple(
                    canonical(config, group.name, f, fault, axes, cell)
                    for f, fault in enumerate(faults)
                )
                plain = {path: float(cell["", path][0]) for path in parameters}
                of_cross = {path: float(value) for path, value in zip(crossed, values, strict=True)}
                yield group.name, rows, plain | of_cross, repeat, number * len(drawn)


def axes_of(config, fault):
    site = SITES[fault.site]
    names = [channel.name for channel in site.channels]
    out = {name: getattr(fault, name) for name in FIELDS[1:]}
    out["arm"] = fault.arm or fixed_axis(config.campaign.arms[0] if site.per_arm else "")
    if fault.channel is None:
        out["channel"] = fixed_axis(names[0] if len(names) == 1 else "")
    elif fault.channel.listed == ("*",):
        out["channel"] = Axis("list", tuple(names))
    out["value"] = fault.value or fixed_axis(math.nan)
    return out


def cells(group, axes, rng):
    """(repeat, {axis: (its value, the same rounded where it was drawn)}) of each run."""
    constant = {key: (a.values[0],) * 2 for key, a in axes.items() if a.kind == "fixed"}
    lists = {key: [(v, v) for v in a.values] for key, a in axes.items() if a.kind == "list"}
    drawn = {key: a for key, a in axes.items() if a.kind not in ("fixed", "list")}
    if group.design in ("random", "lhs", "sobol"):
        drawn = {key: a for key, a in axes.items() if a.kind != "fixed"}
        sample = unit(group.design, group.runs, len(drawn), rng)
        for row, repeat in itertools.product(range(group.runs), range(group.repeats)):
            yield (
                repeat,
                constant
                | {key: draw(axis, sample[row, i]) for i, (key, axis) in enumerate(drawn.items())},
            )
        return
    if group.design == "zip":
        longest = max((len(values) for values in lists.values()), default=1)
        combinations = list(
            zip(*(v * longest if len(v) == 1 else v for v in lists.values()), strict=True)
        ) or [()]
    else:
        combinations = list(itertools.product(*lists.values()))
    sample = unit("random", len(combinations) * group.repeats, len(drawn), rng)
    for row, (values, repeat) in enumerate(itertools.product(combinations, range(group.repeats))):
        picked = {key: draw(axis, sample[row, i]) for i, (key, axis) in enumerate(drawn.items())}
        yield repeat, constant | dict(zip(lists, values, strict=True)) | picked


def unit(design, rows, dimensions, rng):
    if design == "random" or dimensions == 0:
        return rng.random((rows, dimensions))
    sampler = (
        qmc.LatinHypercube(dimensions, rng=rng)
        if design == "lhs"
        else qmc.Sobol(dimensions, rng=rng)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return sampler.random(rows)


def draw(axis, u):
    """A value as it is drawn, and rounded to a whole one where it is no word."""
    values, kind = axis.values, axis.kind
    if kind in ("list", "choice"):
        return (values[min(int(u * len(values)), len(values) - 1)],) * 2
    low, high = (float(v) for v in values)
    if kind == "normal":
        real = low + high * float(ndtri(min(max(u, 1e-12), 1.0 - 1e-12)))
    elif kind == "loguniform":
        real = float(np.exp(math.log(low) + u * (math.log(high) - math.log(low))))
        return real, min(max(round(real), math.ceil(low)), math.floor(high))
    else:
        whole = min(
            math.floor(low) + math.floor(u * (math.floor(high) - math.floor(low) + 1.0)), high
        )
        return low + u * (high - low), round(whole)
    return real, round(real)


def canonical(config, group, slot, fault, axes, cell):
    out = {"site": fault.site} | {
        name: cell[slot, name][name in LEAST] for name in axes_of_slot(axes, slot)
    }
    for name, least in LEAST.items():
        out[name] = UNTIL_END if out[name] == END else max(int(out[name]), least)
    effect = out["effect"]
    out["channel"] = NETWORK_EFFECTS[effect][0] if effect in NETWORK_EFFECTS else out["channel"]
    out["period_ms"] = out["period_ms"] if effect == "periodic" else 0
    if effect in ("stuck", "drop", "duplicate"):
        return out | {"value": math.nan}
    channel = SITES[fault.site].channel(out["channel"])
    beyond = fault.wraps or (fault.site == "usb_out" and config.campaign.dac_words is not None)
    rule = legal_values(channel, effect, beyond)
    return out | {"value": float(cell[slot, "value"][rule.rounded])}


def axes_of_slot(axes, slot):
    return [name for s, name in axes if s == slot]

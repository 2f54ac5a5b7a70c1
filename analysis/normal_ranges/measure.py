"""Measures the normal range of each channel on which a fault can act: its range in fault-free
motion. Writes normal_ranges.csv of the Raven-II.

    python analysis/normal_ranges/measure.py

The script runs every generated motion, 20 s each, at teleoperation scales 0.05 and 0.1. It uses
both arms, the present raven2 software, a console that sends increments, and no noise. The table
contains the minimum, the 0.1 and 99.9 percentiles, and the maximum over all ticks of all runs.
Larger scales are not used, because commands are then limited: at scale 0.2 for up to a fifth of the
time.
"""

import csv
from collections.abc import Iterator
from typing import Any

import numpy as np

from ravenjax.campaign import loading, plan
from ravenjax.campaign.inspection import replay
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.faults.injection import read_channel
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.declaration import RANGES as TARGET
from ravenjax.robots.raven2.declaration import SITES
from ravenjax.robots.raven2.geometry.mapping import quat_from_matrix
from ravenjax.robots.raven2.stages import plc
from ravenjax.vocabulary.sites import ARM, Channel

SCALES = (0.05, 0.1)
SECONDS = 20.0

NEUTRAL = {
    "hand": 0.0,
    "network": 0.0,
    "buttons": 0.0,
    "usb_status": 1.0,
    "torque_scale": 1.0,
    "cable_scale": 1.0,
    "friction_scale": 1.0,
    "external_torque": 0.0,
}
"""Sites that hold a single number without a fault."""


def crossing(signals: Any, scale: float) -> dict[str, Any]:
    """Return a map from site to the signal at it, as `vocabulary.sites` describes it, for all sites
    except those in NEUTRAL.
    """

    def of(name: str) -> tuple[Any, ...]:
        return tuple(getattr(arm, name) for arm in signals.control.arms)

    return {
        "console": _Fields(scale=np.full_like(signals.control.tick, scale, float)),
        "packet": signals.packet,
        "packet_header": signals.packet,
        "encoder": tuple(out.enc_val for out in signals.plant),
        "usb_in": _Fields(
            enc_val=of("enc_val"),
            pins=(plc.input_pins(np.asarray(signals.plc.runlevel)),) * len(ARMS),
        ),
        "runlevel": signals.control.runlevel,
        **{
            name: of(name)
            for name in ("mpos", "mvel", "jpos", "jvel", "jpos_d", "mpos_d", "tau_d", "current_cmd")
        },
        **{name: tuple(Vec(pose.position_um) for pose in of(name)) for name in ("pos", "pos_d")},
        **{
            name: tuple(quat_from_matrix(Vec(map(Vec, pose.rotation))) for pose in of(pose_name))
            for name, pose_name in (("ori", "pos"), ("ori_d", "pos_d"))
        },
        "usb_out": of("current_cmd_written"),
        "pins_out": signals.control.pins_out,
        "plc": signals.plc.runlevel,
        "brake": signals.plc.brakes,
    }


class _Fields:
    def __init__(self, **fields: Any) -> None:
        self.__dict__.update(fields)


def runs() -> Iterator[tuple[Any, float]]:
    """Yield (signals, scale) of each fault-free run."""
    for motion in MOTIONS:
        campaign = {"name": "normal", "duration_s": SECONDS, "arms": list(ARMS)}
        group = {"name": "fault_free", "parameters": {"operator.scale": list(SCALES)}}
        raw = {"campaign": campaign, "operator": {"motion": motion}, "group": [group]}
        ready = plan.make_plan(loading.from_dict(raw))
        tracer = selection.select_engine("simd", ready.program.setup.precision).tracer(
            ready.program, replay.LANES
        )
        for row, scale in enumerate(SCALES):
            block = Block(*ready.lanes([row], replay.LANES), None)
            _, _, signals = tracer.run(block, block, ready.columns)
            for arm in signals.control.arms:
                if not np.array_equal(arm.current_cmd, arm.current_cmd_written):
                    raise SystemExit(
                        f"{motion} at scale {scale}: the overdrive check clips, so the run is not"
                        " normal"
                    )
            yield signals, scale


def channels() -> Iterator[tuple[str, str, Channel, tuple[str | int, ...]]]:
    """Return (site, arm or "", channel, path in the site's signal) for everything that a fault can
    act on.
    """
    for site in SITES.values():
        for i, arm in enumerate(ARMS if site.per_arm else ("",)):
            for channel in site.channels:
                yield (
                    site.name,
                    arm,
                    channel,
                    tuple(i if step == ARM else step for step in channel.path),
                )


def main() -> None:
    """Run everything and write the table."""
    seen: dict[tuple[str, str, str], list[np.ndarray]] = {}
    for signals, scale in runs():
        found = crossing(signals, scale)
        ticks = len(np.asarray(signals.control.tick))
        for site, arm, channel, path in channels():
            values = (
                np.full(ticks, NEUTRAL[site])
                if site in NEUTRAL
                else np.asarray(read_channel(found[site], path))
            )
            seen.setdefault((site, arm, channel.name), []).append(values.astype(float))
    with open(TARGET, "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("site", "arm", "channel", "unit", "min", "p0.1", "p99.9", "max", "ticks"))
        for (site, arm, name), parts in seen.items():
            values = np.concatenate(parts)
            numbers = np.quantile(values, (0.0, 0.001, 0.999, 1.0))
            unit = SITES[site].channel(name).unit
            rows.writerow(
                (site, arm, name, unit, *(f"{number:.6g}" for number in numbers), len(values))
            )
    print(f"wrote {TARGET}: {len(seen)} channels")


if __name__ == "__main__":
    main()

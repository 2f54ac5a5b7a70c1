"""Study: what changes if the force of the haptic cue moves the operator's hand, and robot and
nominal model follow this hand?
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.sections.reaction import Pairs
from ravenjax.stages.hand import HandParams, hand_impedance
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate
from ravenjax.vocabulary.reactions import RELEASE
from studies import kinds, reacting_operator, study
from studies.reacting_operator import number
from studies.runs import read
from studies.study import Line, in_percent, own_line, read_table

NAME = "hand"
DELAYS_MS = (155.0, 190.0, 250.0, 384.0, 725.0, 1250.0, 1500.0)
"""Published times from a stimulus to an action, and the default of `[reaction] delay_ms`."""
NEWTONS_COLUMN, GRIP_COLUMN = "param:hand.newtons_per_unit", "param:hand.grip"
SCALE, KP, CAP = 0.1, 4.5, 0.05  # as in the campaign; device units per m, device units
MIDDLE, ENDS = 0.5, (0.0, 1.0)
"""Grips. At the first the force is varied; at the others it is either the strongest or none."""
FORCES = {
    3.3: "one device unit is 3.3 N",
    66.0: "the cap is 3.3 N",
    -66.0: "null: the same, away from the model",
}
"""N per device unit -> words."""
STRONG = 66.0
MOVES, STOPPED = "robot not stopped", "robot stopped by a check"
SIZES_MM = (5.0, 10.0, 20.0)


class HandEffect(NamedTuple):
    """What a force changed, over the faults in which it moved a hand, with intervals over kinds."""

    pairs: int  # number of faults
    pulled: int  # of these: faults in which the hand moved
    kinds: Units  # kinds of faults in which the hand moved
    hand: Estimate  # mm, mean of the largest displacement
    model: Estimate  # mm, mean change of the root mean square distance from the model
    golden: Estimate  # mm, the same of the distance from the golden run
    # Mean absolute changes of these distances, as fractions of the commanded motion of the tip.
    model_share: Estimate
    golden_share: Estimate
    cue_ms: Estimate  # mean change of the cue's time
    pulses: Estimate  # mean change of the number of separate pulls
    path: Estimate  # mean change of the tip's path, as a share of the path
    unintended: tuple[int, int]  # faults with an unintended motion: without and with the force
    difference: Estimate  # difference of their shares of all pairs


Effects = Mapping[tuple[str, str, str], HandEffect]
"""By force, grip, and whether a check stopped the robot."""


def paired(frame: pd.DataFrame, newtons: float, grip: float) -> Pairs:
    """Return every fault that changed a bit, with and without that force per unit, at that grip."""
    at_grip = np.isclose(frame[GRIP_COLUMN], grip)
    on, off = (
        frame.loc[at_grip & np.isclose(frame[NEWTONS_COLUMN], value)].sort_values("pair")
        for value in (newtons, 0.0)
    )
    valid = ~(on["failed"].to_numpy(bool) | off["failed"].to_numpy(bool))
    return Pairs(on, off).where(valid & off["activated"].to_numpy(bool))


def stopped(pairs: Pairs) -> np.ndarray:
    """Return pairs in which a check stopped a robot: then only the model follows the hand."""
    on, off = ((part["response"] == "stopped").to_numpy(bool) for part in pairs)
    return on | off


def effect(pairs: Pairs, scale: float) -> HandEffect:
    """Return what the force changed. `scale`: teleoperation scale."""
    pulled = pairs.where((pairs.with_["hand_mm"] > 0).to_numpy())
    among = kinds.of(pulled.without["group"])

    def change(column: str) -> np.ndarray:
        on, off = (part[column].to_numpy(float) for part in pulled)
        return on - off

    def ratio(above: np.ndarray, below: np.ndarray | float = 1.0) -> Estimate:
        return units.ratio_band(above, below, among)

    hand_mm = pulled.with_["hand_mm"].to_numpy(float)
    model, golden = (change(f"rms_{name}_deviation_mm") for name in ("model", "golden"))
    with_, without = (part["unintended"].to_numpy(bool) for part in pairs)
    return HandEffect(
        len(with_),
        len(hand_mm),
        among,
        ratio(hand_mm),
        ratio(model),
        ratio(golden),
        ratio(np.abs(model), scale * hand_mm),
        ratio(np.abs(golden), scale * hand_mm),
        ratio(change("cue0_ms")),
        ratio(change("cue0_count")),
        ratio(change("tip_path_mm"), pulled.without["tip_path_mm"].to_numpy(float)),
        (int(without.sum()), int(with_.sum())),
        kinds.difference(with_, without, kinds.of(pairs.without["group"])),
    )


def compare(context: study.Context) -> study.Findings:
    """Compare effects of the force by size and grip with null models, and reaction times."""
    force, grip, turned, cycle = (
        read(context.folders[name]).frame for name in ("force", "grip", "turned", "every_cycle")
    )
    drawn = "null: the cap is 3.3 N, at a drawn direction"
    pairs = {
        **{(words, MIDDLE): paired(force, one, MIDDLE) for one, words in FORCES.items()},
        **{(FORCES[STRONG], end): paired(grip, STRONG, end) for end in ENDS},
        (drawn, MIDDLE): paired(turned, STRONG, MIDDLE),
        (f"{FORCES[STRONG]}, a packet each cycle", MIDDLE): paired(cycle, STRONG, MIDDLE),
    }
    effects = {
        (words, f"{at:g}", robot): effect(some.where(stopped(some) == (robot == STOPPED)), SCALE)
        for (words, at), some in pairs.items()
        for robot in (MOVES, STOPPED)
    }
    released = {
        delay: reacting_operator.paired(read(context.folders[f"delay_{delay:g}"]), RELEASE)
        for delay in DELAYS_MS
    }
    times = (study.HERE / "published" / "reaction_times.md").read_text(encoding="utf-8")
    rows = {
        "followed": _followed(effects),
        "changed": _changed(effects),
        "loop": loop_rows(),
        # ms, stimulus and response, source, applies to
        "times": [line.split(" | ") for line in times.splitlines() if " | " in line],
        "avoided": _avoided(released),
    }
    tables = tuple(read_table(NAME, key, table) for key, table in rows.items())
    return study.Findings(tuple(_lines(released)), tables, study.read_notes(NAME))


def _lines(released: Mapping[float, Pairs]) -> Iterator[Line]:
    for delay, part in released.items():
        contrast = reacting_operator.contrast_of(part, 20.0)
        of = f"faults that make it where nobody reacts, {kinds.count(contrast.affected)}"
        yield own_line(
            f"lifting the pedal after {delay:g} ms avoids, of motions of more than 20 mm",
            "%",
            in_percent(contrast.avoided, contrast.avoided.n, of),
        )


def _followed(effects: Effects) -> Iterator[tuple[str | int, ...]]:
    for words, one in effects.items():
        estimates = one.hand, one.model, one.golden, one.model_share, one.golden_share
        moved = f"{one.pulled}, {kinds.count(one.kinds)}"
        yield *words, one.pairs, moved, *map(number, estimates)


def _changed(effects: Effects) -> Iterator[tuple[str | int, ...]]:
    for words, one in effects.items():
        points, path = (
            Estimate(*(100.0 * part for part in value)) for value in (one.difference, one.path)
        )
        yield *words, *one.unintended, *map(number, (points, one.cue_ms, one.pulses, path))


def loop_rows() -> Iterator[tuple[str | float, ...]]:
    """Yield the gain of the loop from the model through cue and hand back, for a robot at rest."""
    for newtons, words in FORCES.items():
        for grip in (ENDS[0], MIDDLE, ENDS[1]) if newtons > 0 else ():
            params = HandParams(grip, newtons, 0.554, 6.45, 135.0, 5.0, 0.0)
            stiffness = float(hand_impedance(params)[0])
            farthest, gain = CAP * newtons / stiffness * 1e3, KP * newtons / stiffness
            numbers = farthest, SCALE * farthest, SCALE * gain, 1 / gain
            yield words, grip, *(f"{value:.2g}" for value in numbers)


def _avoided(released: Mapping[float, Pairs]) -> Iterator[tuple[str | int, ...]]:
    for delay, part in released.items():
        contrasts = [reacting_operator.contrast_of(part, size) for size in SIZES_MM]
        yield f"{delay:g}", contrasts[0].n, *map(reacting_operator.avoided, contrasts)


STUDY = study.study(NAME, variants=study.read_variants(NAME), compare=compare)

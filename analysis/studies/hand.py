"""Study: what changes if the force of the haptic cue moves the operator's hand, and robot and
nominal model follow this hand?
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.sections.reaction import Pairs
from ravenjax.stages.hand import HandParams, hand_impedance
from ravenjax.stats import units
from ravenjax.stats.intervals import Estimate
from ravenjax.stats.units import Units
from ravenjax.vocabulary.reactions import RELEASE
from studies import kinds, reacting_operator, study
from studies.reacting_operator import number
from studies.runs import acting_pairs, read
from studies.study import percent_line

NAME = "hand"
DELAYS_MS = (155.0, 190.0, 250.0, 384.0, 725.0, 1250.0, 1500.0)
"""Published times from a stimulus to an action, and the default of `[reaction] delay_ms`."""
NEWTONS_COLUMN, GRIP_COLUMN = "param:hand.newtons_per_unit", "param:hand.grip"
SCALE, KP, CAP = 0.1, 4.5, 0.05  # as in the campaign; device units per m, device units
GRIPS = RELAXED, MIDDLE, FIRM = (0.0, 0.5, 1.0)
"""At the middle grip the force is varied; at the others it is either the strongest or none."""
STRONG = 66.0
FORCES = {
    3.3: "one device unit is 3.3 N",
    STRONG: "the cap of 0.05 units is 3.3 N",
    -STRONG: "null model: cap 3.3 N, force away from the model",
}
"""N per device unit -> words."""
SIZES_MM = (5.0, 10.0, 20.0)
CHANGED = ("rms_model_deviation_mm", "rms_golden_deviation_mm", "cue0_ms", "cue0_count")
"""Columns whose mean change is reported, beside that of `tip_path_mm`."""


class HandEffect(NamedTuple):
    """Effect of a force over the faults in which it moved a hand, with intervals over kinds."""

    pairs: int  # number of faults
    pulled: int  # of these: faults in which the hand moved
    kinds: Units  # kinds of faults in which the hand moved
    hand: Estimate  # mm, mean of the largest displacement
    model: Estimate  # mm, mean change of the root mean square distance from the model
    golden: Estimate  # mm, the same of the distance from the golden run
    # Mean absolute changes of these distances, as fractions of the commanded motion of the tip.
    model_share: Estimate
    golden_share: Estimate
    cue_ms: Estimate  # mean change of the time with force
    pulses: Estimate  # mean change of the number of separate pulses
    path: Estimate  # mean change of the tip's path, as a share of the path
    unintended: tuple[int, int]  # faults with an unintended motion: without and with the force
    difference: Estimate  # difference of their shares of all pairs


def paired(frame: pd.DataFrame, newtons: float, grip: float) -> Pairs:
    """Return every fault that changed a bit, with and without this force per unit, at this grip."""
    at_grip = frame.loc[np.isclose(frame[GRIP_COLUMN], grip)]
    return acting_pairs(
        *(at_grip.loc[np.isclose(at_grip[NEWTONS_COLUMN], value)] for value in (newtons, 0.0))
    )


def effect(pairs: Pairs) -> HandEffect:
    """Return the effect of the force."""
    pulled = pairs.where((pairs.with_["hand_mm"] > 0).to_numpy())
    among, hand_mm = kinds.of(pulled.without["group"]), pulled.with_["hand_mm"].to_numpy(float)
    on, off = (part[[*CHANGED, "tip_path_mm"]].to_numpy(float).T for part in pulled)
    model, golden, cue_ms, pulses, path = on - off
    with_, without = (part["unintended"].to_numpy(bool) for part in pairs)

    def ratio(above: np.ndarray, below: np.ndarray | float = 1.0) -> Estimate:
        return units.ratio_band(above, below, among)

    return HandEffect(
        pairs=len(with_),
        pulled=len(hand_mm),
        kinds=among,
        hand=ratio(hand_mm),
        model=ratio(model),
        golden=ratio(golden),
        model_share=ratio(np.abs(model), SCALE * hand_mm),
        golden_share=ratio(np.abs(golden), SCALE * hand_mm),
        cue_ms=ratio(cue_ms),
        pulses=ratio(pulses),
        path=ratio(path, off[-1]),
        unintended=(int(without.sum()), int(with_.sum())),
        difference=kinds.difference(with_, without, kinds.of(pairs.without["group"])),
    )


def compare(context: study.Context) -> study.Findings:
    """Compare effects of the force by size and grip with null models, and reaction times."""
    force, grip, turned, cycle = (
        read(context.folders[name]).frame for name in ("force", "grip", "turned", "every_cycle")
    )
    drawn = "null model: cap 3.3 N, force in a random direction"
    pairs = {
        **{(words, MIDDLE): paired(force, one, MIDDLE) for one, words in FORCES.items()},
        **{(FORCES[STRONG], end): paired(grip, STRONG, end) for end in (RELAXED, FIRM)},
        (drawn, MIDDLE): paired(turned, STRONG, MIDDLE),
        (f"{FORCES[STRONG]}, one packet per cycle", MIDDLE): paired(cycle, STRONG, MIDDLE),
    }
    followed, changed = [], []
    for (words, at), some in pairs.items():
        # If a check stopped either robot, only the model follows the hand.
        stopped = np.any([part["response"] == "stopped" for part in some], axis=0)
        for robot, mine in (("robot not stopped", ~stopped), ("robot stopped by a check", stopped)):
            one, heads = effect(some.where(mine)), (words, f"{at:g}", robot)
            moved = f"{one.pulled}, {kinds.count(one.kinds)}"
            shown = one.hand, one.model, one.golden, one.model_share, one.golden_share
            followed.append((*heads, one.pairs, moved, *map(number, shown)))
            points, path = (
                Estimate(*(100.0 * part for part in value)) for value in (one.difference, one.path)
            )
            shown = points, one.cue_ms, one.pulses, path
            changed.append((*heads, *one.unintended, *map(number, shown)))
    released = {
        delay: reacting_operator.paired(read(context.folders[f"delay_{delay:g}"]), RELEASE)
        for delay in DELAYS_MS
    }
    lines, avoided = [], []
    for delay, part in released.items():
        contrasts = [reacting_operator.contrast_of(part, size) for size in SIZES_MM]
        shares = map(reacting_operator.avoided, contrasts)
        avoided.append((f"{delay:g}", contrasts[0].n, *shares))
        words = f"unintended motions over 20 mm that a pedal lifted after {delay:g} ms avoids"
        of = f"faults with such a motion if nobody reacts, {kinds.count(contrasts[-1].affected)}"
        lines.append(percent_line(words, contrasts[-1].avoided, of))
    times = (study.HERE / "published" / "reaction_times.md").read_text(encoding="utf-8")
    tables = {
        "followed": followed,
        "changed": changed,
        "loop": loop_rows(),
        # ms, stimulus and response, source, applies to
        "times": [line.split(" | ") for line in times.splitlines() if " | " in line],
        "avoided": avoided,
    }
    return study.findings(NAME, lines, tables)


def loop_rows() -> Iterator[tuple[str | float, ...]]:
    """Yield the gain of the loop of model, cue and hand, for a robot at rest."""
    for newtons, words in FORCES.items():
        for grip in GRIPS if newtons > 0 else ():
            params = HandParams(grip, newtons, 0.554, 6.45, 135.0, 5.0, 0.0)
            stiffness = float(hand_impedance(params)[0])
            farthest, gain = CAP * newtons / stiffness * 1e3, KP * newtons / stiffness
            numbers = farthest, SCALE * farthest, SCALE * gain, 1 / gain
            yield words, grip, *(f"{value:.2g}" for value in numbers)


STUDY = study.study(NAME, study.read_variants(NAME), compare)

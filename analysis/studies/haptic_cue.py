"""Study of the haptic cue: for which faults does it come, when and how strongly, how many false
cues come, and which threshold is best?

A cue of a faulty run counts from the fault's first effect on, and only if it had not come in the
golden run by that time. The cost of a threshold is weight x (share of hazards missed) + false cues
per hour. The weight is unknown, so it is swept.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.outcomes import events
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report import wording
from ravenjax.stats import units
from ravenjax.stats.units import Units, group_units
from studies import runs, study
from studies.cells import hourly, percent, plain, quartiles
from studies.runs import AS_MODELLED, MOVED, SCALE, UNCERTAIN, Runs, of_robot, share, unclutched
from studies.study import Cell, read_table

NAME = "haptic_cue"
RESAMPLES = 2000
WEIGHTS = (1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0)
"""Weights shown in tables."""
SURE = 0.95
"""Share of resamples that a set must win to be named."""
HAZARDS = {
    "unintended motion": "unintended",
    "injury-capable motion": "injury",
    "jump of the true tip": "jump_tip",
}
"""What a cue is to announce, and its column."""
UNINTENDED = next(iter(HAZARDS))
NEVER, LATE = "no cue comes", "no cue comes before the motion"
"""Meanings of a missed hazard."""
AT_CAP = 0.999
"""Share of the cap from which a force counts as capped, because forces are stored as float32."""
SLOW = 0.1
"""Largest scale of motion that is called slow."""
EARLY_MM = 1.0
"""A threshold below the limit of the unintended motion, which is compared for any choice."""
Rows = Iterator[tuple[Cell, ...]]


class Choice(NamedTuple):
    """The choice at one weight."""

    weight: float
    winner: int  # number of the winning set
    wins: np.ndarray  # [sets], share of resamples in which it wins; sums to 1
    cost: np.ndarray  # [sets], false cues an hour
    sure: bool  # whether the choice is certain enough to be named


def choose(
    missed: np.ndarray,
    faults: Units,
    false: np.ndarray,
    hours: np.ndarray,
    recording: np.ndarray,
    weights: Sequence[float] = WEIGHTS,
) -> list[Choice]:
    """Return the cheapest set at each weight; of equals the highest-numbered one.

    `missed`: bool [hazards, sets], of these kinds of faults. `false`: cues [free runs, sets] in
    these hours [free runs] of recordings [free runs]. Kinds and recordings are resampled. A rate
    with no observed event is drawn from an exponential distribution of mean 1 / hours, whose 97.5 %
    quantile is the end of the exact interval for a Poisson count of 0.
    """
    free, sets = group_units(recording), missed.shape[1]
    missed, hazards = _by(faults, missed), _by(faults, np.ones(len(missed)))
    false, hours = _by(free, false), _by(free, hours)
    rng = np.random.default_rng(0)
    kinds_drawn = faults.weights(RESAMPLES)
    drawn = rng.multinomial(free.count, np.full(free.count, 1 / free.count), RESAMPLES)
    shares = (kinds_drawn @ missed) / (kinds_drawn @ hazards)[:, None]
    cues = drawn @ false
    rates = np.where(cues > 0, cues, rng.exponential(size=cues.shape)) / (drawn @ hours)[:, None]
    choices = []
    for weight in weights:
        cost = weight * (missed.sum(axis=0) / hazards.sum()) + false.sum(axis=0) / hours.sum()
        wins = np.bincount(_cheapest(weight * shares + rates), minlength=sets) / RESAMPLES
        winner = int(_cheapest(cost))
        choices.append(Choice(weight, winner, wins, cost, bool(wins[winner] >= SURE)))
    return choices


def _cheapest(cost: np.ndarray) -> np.ndarray:
    """Return the last of the cheapest [..., sets]. Costs that differ only by rounding are equal."""
    near = cost <= cost.min(axis=-1, keepdims=True) * (1 + 1e-12)
    return cost.shape[-1] - 1 - np.argmax(near[..., ::-1], axis=-1)


def _by(among: Units, values: np.ndarray) -> np.ndarray:
    """Return sums of values [rows, ...] over each unit."""
    total = np.zeros((among.count, *values.shape[1:]))
    np.add.at(total, among.unit, values)
    return total


def first_ms(faulty: Runs, k: int) -> np.ndarray:
    """Return the first cue of set number k because of the fault, ms [runs]; -1: none."""
    times = runs.warning_times(faulty, k)
    return np.where(times >= faulty["active_ms"], times, -1)


def missed(faulty: Runs, sets: Sequence[int], miss: str = NEVER) -> np.ndarray:
    """Return in which runs each set gave no cue, or came too late, bool [runs, sets]."""
    first, began = np.stack([first_ms(faulty, k) for k in sets], axis=1), faulty["unintended_ms"]
    late = (first >= began[:, None]) & (began >= 0)[:, None]
    return (first < 0) | late if miss == LATE else first < 0


def choices(
    faulty: Runs, free: Runs, sets: Sequence[int], hazard: str = UNINTENDED, miss: str = NEVER
) -> list[Choice]:
    """Return the choices among `sets` to announce one of HAZARDS. `miss`: NEVER or LATE."""
    hazards = faulty.where(faulty[HAZARDS[hazard]].astype(bool))
    false = np.stack([free[f"cue{k}_count"] for k in sets], axis=1)
    lost = missed(hazards, sets, miss)
    return choose(lost, hazards.faults, false, free["hours"], free["recording"])


def felt(faulty: Runs, k: int) -> dict[str, Any]:
    """Return how set number k announces faults that cause an unintended motion: rates as fractions,
    medians in ms, and texts for values with quartiles.
    """
    moved, first = faulty["unintended"], first_ms(faulty, k)
    came = first >= 0
    once, mine = faulty.where(moved).once(), faulty.where(moved & came)
    cap, force = faulty.made.cues[k].cap, mine[f"cue{k}_peak_force"].astype(float)
    at_cap = force >= AT_CAP * (np.inf if cap is None else cap)
    # From the fault's first effect, and before the unintended motion
    delay, lead = runs.median_times(once, first_ms(once, k))
    early = came & (first < faulty["unintended_ms"])
    return {
        # Of runs with an unintended motion: without a cue, and with a cue before the motion began
        "missed": share(~came, moved, faulty.faults, MOVED),
        "before": share(early, moved, faulty.faults, MOVED),
        "others": share(came, ~moved, faulty.faults, "other faulty runs"),
        "delay_ms": delay,
        "lead_ms": lead,
        # Of unintended motions with a cue: largest force, those at the cap, time with force
        "force": quartiles(force),
        "at_cap": share(at_cap, np.ones(len(at_cap), bool), mine.faults, "runs with a cue"),
        "felt_ms": quartiles(mine[f"cue{k}_ms"]),
    }


def false_cues(free: Runs, k: int) -> dict[str, Any]:
    """Return false cues per hour of set k, with the robot as modelled and with uncertain robots,
    and words for the share of motion of the robot as modelled in which it pulls.
    """
    modelled, uncertain = of_robot(free, AS_MODELLED), of_robot(free, UNCERTAIN)
    hours, pulled = modelled["hours"], modelled[f"cue{k}_ms"] / 3.6e6
    band = units.ratio_band(pulled, hours, group_units(modelled["recording"]))
    shares = pulled.sum() / hours.sum(), band.low, band.high
    value, low, high = map(wording.format_percent, shares)
    ends = f" ({low} to {high})" if pulled.any() and not np.isnan(band.low) else ""
    return {
        "false": runs.per_hour(modelled, modelled[f"cue{k}_count"], "cues"),
        "false_time": f"{value}{ends} of {hours.sum():.1f} h",
        "false_uncertain": runs.per_hour(uncertain, uncertain[f"cue{k}_count"], "cues"),
    }


FORMS = {
    **dict.fromkeys(("missed", "before", "others", "at_cap"), percent),
    **dict.fromkeys(("delay_ms", "lead_ms"), plain),
    **dict.fromkeys(("false", "false_uncertain"), hourly),
}
"""How the numbers of `felt` and `false_cues` are written."""
BY_GAIN = ("missed", "delay_ms", "force", "at_cap", "felt_ms", "false")
BY_THRESHOLD = (
    *("missed", "before", "others", "delay_ms", "lead_ms"),
    *(*BY_GAIN[2:], "false_time", "false_uncertain"),
)
"""Numbers in the tables of thresholds and gains."""


def choice_rows(thresholds: Sequence[float], published: int, chosen: Sequence[Choice]) -> Rows:
    """Yield the choice at each weight. `published`: place of the published threshold."""
    for weight, winner, wins, cost, sure in chosen:
        others = [
            f"{thresholds[k]:g} mm {100 * wins[k]:.0f} %"
            for k in np.argsort(-wins, kind="stable")
            if k != winner and wins[k] >= 0.01
        ]
        mm = thresholds[winner]
        named = mm if sure else f"undecided, lowest cost at {mm:g}"
        costs = [float(f"{cost[k]:.3g}") for k in (winner, published)]
        won = [f"{100 * wins[k]:.0f} %" for k in (winner, published)]
        yield f"{weight:,.0f}", named, won[0], ", ".join(others), *costs, won[1]


def rule_rows(faulty: Runs, free: Runs, sets: Sequence[int]) -> Rows:
    """Yield the choice for other hazards, meanings of a miss and fault-free motion."""
    published, modelled = faulty.made.verdict_cue, of_robot(free, AS_MODELLED)
    slow = modelled.where(modelled[SCALE] <= SLOW + 1e-9)
    for hazard, miss, motion, mine in (
        *((hazard, NEVER, "every motion and scale", modelled) for hazard in HAZARDS),
        (UNINTENDED, LATE, "every motion and scale", modelled),
        (UNINTENDED, NEVER, f"scales up to {SLOW:g}", slow),
        (UNINTENDED, NEVER, f"scales up to {SLOW:g}, no clutching", unclutched(slow)),
        (UNINTENDED, LATE, f"scales up to {SLOW:g}, no clutching", unclutched(slow)),
        (UNINTENDED, NEVER, UNCERTAIN, of_robot(free, UNCERTAIN)),
    ):
        hit = faulty[HAZARDS[hazard]].astype(bool)
        if not hit.any() or not mine["hours"].sum() > 0:
            continue
        lost = share(missed(faulty, [published], miss)[:, 0], hit, faulty.faults, "")
        names = [
            f"{'' if at.sure else 'undecided: '}{faulty.made.cues[sets[at.winner]].threshold_mm:g}"
            f" ({100 * at.wins[at.winner]:.0f} %)"
            for at in choices(faulty, mine, sets, hazard, miss)
        ]
        yield hazard, miss, motion, percent(lost), *names


def compare(context: study.Context) -> study.Findings:
    """Compare all sets over the same runs."""
    faulty = runs.pooled(context.folders)
    recordings = {name: path for name, path in context.folders.items() if name.startswith("free_")}
    free = runs.joined([*map(runs.fault_free, recordings.values())])
    modelled, published = of_robot(free, AS_MODELLED), faulty.made.verdict_cue
    thresholds = [cue.threshold_mm for cue in faulty.made.cues]
    gains = [(cue.kp_per_mm, cue.kd_s_per_mm) for cue in faulty.made.cues]
    # The sets with the published gains, by rising threshold
    rising = sorted(range(len(gains)), key=thresholds.__getitem__)
    sets = [k for k in rising if gains[k] == gains[published]]
    chosen = choices(faulty, modelled, sets)
    early = [k for k in sets if thresholds[k] == EARLY_MM]
    winners = [sets[winner] for winner in sorted({at.winner for at in chosen})]
    compared = list(dict.fromkeys([published, *early, *winners]))
    # Every set with one of the first two thresholds of these
    tried = dict.fromkeys(thresholds[k] for k in compared[:2])
    others = [k for mm in tried for k in range(len(gains)) if thresholds[k] == mm]
    found = {k: felt(faulty, k) | false_cues(free, k) for k in {*sets, *others}}
    cells = {
        k: {name: FORMS.get(name, str)(value) for name, value in numbers.items()}
        for k, numbers in found.items()
    }
    written = [(kp, np.format_float_positional(kd, trim="-")) for kp, kd in gains]
    tables = {
        "thresholds": ((thresholds[k], *map(cells[k].get, BY_THRESHOLD)) for k in sets),
        "choice": choice_rows([thresholds[k] for k in sets], sets.index(published), chosen),
        "rules": rule_rows(faulty, free, sets),
        "gains": ((thresholds[k], *written[k], *map(cells[k].get, BY_GAIN)) for k in others),
    }
    words = {"mm": thresholds[published], "sure": 100 * SURE, "limit_mm": LIMIT_MM}
    return study.Findings(
        (
            *runs.design_lines(faulty, modelled),
            *(line for k in compared for line in _lines(thresholds[k], k == published, found[k])),
        ),
        tuple(read_table(NAME, key, rows, **words) for key, rows in tables.items()),
        study.read_notes(
            NAME,
            motion=events.event_meaning("unintended_motion", faulty.made.rules),
            hours=modelled["hours"].sum(),
            recordings=len(np.unique(modelled["recording"])),
        ),
    )


def _lines(mm: float, published: bool, found: Mapping[str, Any]) -> Iterator[study.Line]:
    """Yield the lines of the haptic set with the threshold `mm`."""
    words = f"cue of {mm:g} mm (published): " if published else f"cue of {mm:g} mm: "
    yield study.percent_line(f"{words}unintended motions without a cue", found["missed"])
    yield study.percent_line(f"{words}unintended motions with an earlier cue", found["before"])
    yield study.own_line(f"{words}median lead over the motion", "ms", found["lead_ms"])
    yield study.own_line(f"{words}false cues", "1/h", found["false"])


STUDY = study.study(NAME, study.read_variants(NAME), compare)

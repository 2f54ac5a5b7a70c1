"""Bursts of a constant on the shoulder's DAC (IROS 2016, Figures 4 and 5; targets A4, A5), and
packets struck.

The constant is not published, so none is chosen: whatever is said is said of every constant, or of
all events of the published size, whichever constant made them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from studies.framework import literature
from studies.framework.series import Recorder, Row, Series
from studies.framework.study import Context, Findings, Line, Study, StudyEstimate, Variant
from studies.seed.burst import drawings, tables
from studies.seed.burst.events import BurstEvent, BurstRun, Criteria, criteria, run
from studies.seed.burst.tables import Runs, flat, ranges, stop_words
from studies.seed.motions import MOTIONS, Motion, over_kinds, overrides, variant

CAMPAIGN = "seed_burst.toml"
FREE, BURST, PACKETS = "fault_free", "burst", "packets"
"""Groups of the campaign, in its order."""
CONSTANTS = 69
"""Runs of group BURST."""

MODELLED = "as modelled"
EVERY_CYCLE, DRAWN = "a packet each cycle", ("packets in bursts", "other draws")
SETTINGS: dict[str, tuple[tuple[Motion, ...], tuple[str, ...], str]] = {
    EVERY_CYCLE: (
        MOTIONS,
        ("campaign.packets=every_cycle",),
        "a packet each control cycle, as was assumed before",
    ),
    **{
        f"stop above {limit} counts": (
            MOTIONS,
            (f"parameters.control.overdrive.max_inst_dac={limit}",),
            f"the limit of the check that stops: {of}",
        )
        for limit, of in (
            (13000, "a later fork's"),
            (12000, "the 2015 fork's and the square adapter's"),
        )
    },
    **{
        name: (MOTIONS[:1], changed, question)
        for name, changed, question in (
            (
                "software fork2015",
                ("campaign.software=fork2015",),
                "the control software of the 2015 simulator fork",
            ),
            (
                "hard regulation",
                ("campaign.policy=hard_regulation",),
                "the policy that stops after much clipping",
            ),
            (
                "friction x 0.7",
                ("parameters.plant.gold.friction_scale=0.7",),
                "less friction in the robot",
            ),
            (
                "friction x 1.4",
                ("parameters.plant.gold.friction_scale=1.4",),
                "more friction in the robot",
            ),
            (
                "parameter set traj3",
                ("campaign.parameter_set=traj3",),
                "the authors' law and their active set",
            ),
            (
                "parameter set B",
                ("campaign.parameter_set=B",),
                "the authors' law and their base parameters",
            ),
            (
                DRAWN[0],
                ("campaign.packets=bursts",),
                "packets come as a recorded console sends them",
            ),
            (
                "replay at half speed",
                ("campaign.packets=every_cycle", "parameters.network.cycles_per_packet=2"),
                "each packet lasts two cycles and is the motion's next row",
            ),
            (DRAWN[1], ("campaign.seed=2017",), "the same lengths of packets, drawn again"),
        )
    },
    "model gains x 4": (
        MOTIONS[:1],
        (
            "parameters.nominal.gold.kp.shoulder=774.5359",
            "parameters.nominal.gold.kp.elbow=437.1115",
            "parameters.nominal.gold.kp.insertion=1262.701",
            "parameters.nominal.gold.kd.shoulder=10.32714",
            "parameters.nominal.gold.kd.elbow=5.828154",
            "parameters.nominal.gold.kd.insertion=50.50802",
        ),
        "gains of the nominal model, which the paper does not print",
    ),
}
"""Open questions answered otherwise: with which motions, overrides, question."""


def _variants() -> tuple[Variant, ...]:
    modelled = [
        Variant(variant(m), CAMPAIGN, overrides(m), "" if m == MOTIONS[0] else "another motion")
        for m in MOTIONS
    ]
    limit = f"campaign.limit={1 + CONSTANTS}"
    others = [
        Variant(variant(m, name), CAMPAIGN, (*overrides(m), limit, *changed), question)
        for name, (motions, changed, question) in SETTINGS.items()
        for m in motions
    ]
    return (*modelled, *others)


def compare(context: Context) -> Findings:
    """Measure every run and put its events beside the paper's four."""
    measured = _measured(context)
    published = literature.read("seed")
    rules = criteria(published)
    bursts = _of_group(measured[MODELLED], BURST)
    free = _of_group(measured[MODELLED], FREE)
    settings = {name: _of_group(runs, BURST) for name, runs in measured.items()}
    every = [one for runs in measured.values() for one in flat(runs)]
    lines = (
        *_acceptance(settings, rules, published),
        *_events(bursts, published),
        _false_cues(free, published),
    )
    return Findings(
        lines=lines,
        tables=tables.tables(settings, _of_group(measured[MODELLED], PACKETS), rules),
        drawings=drawings.drawings(bursts, published, rules),
        notes=(*tables.notes(every, settings, rules, published), _packets_note(settings, rules)),
    )


def _packets_note(settings: Mapping[str, Runs], rules: Criteria) -> str:
    """What hangs on how long packets last, in words."""

    def words(name: str, of: Runs) -> str:
        runs = flat(of)
        counts = (sum(map(holds, runs)) for holds in (rules.all_of_a4, *rules.tests.values()))
        return f"{name} {', '.join(map(str, counts))} of {len(runs)}"

    lengths = [name for name in (MODELLED, EVERY_CYCLE, *DRAWN) if name in settings]
    return (
        "How long a packet lasted is not published; packets last as on a recorded arm, while the"
        f" hand keeps its speed. Runs that meet all of A4, then {', '.join(rules.tests)}:"
        f" {'; '.join(words(name, settings[name]) for name in lengths)}. The last two are of the"
        " first motion alone."
    )


def _measured(context: Context) -> dict[str, dict[Motion, list[BurstRun]]]:
    """Runs by setting and motion, the modelled one first; the events of the first motion keep
    their series.
    """
    recorder = Recorder()
    by_setting = {
        MODELLED: {m: _runs(recorder, context, variant(m), m == MOTIONS[0]) for m in MOTIONS}
    }
    for name, (motions, _, _) in SETTINGS.items():
        by_setting[name] = {
            m: _runs(recorder, context, variant(m, name), drawn=False) for m in motions
        }
    return by_setting


def _runs(recorder: Recorder, context: Context, name: str, drawn: bool) -> list[BurstRun]:
    """Each run of a campaign beside the fault-free one, which is the first.

    Every run draws packets of its own, so that this is not quite its golden run. It is asked for
    nothing but steps that are as long as a jump's, above 100 um, and a fault-free tip makes none
    (59 um at most in suture and peg_transfer).
    """
    folder = context.folders[name]
    golden_um = recorder.measure(folder, lambda _, series: series["position"] * 1e6, lambda _: [0])[
        0
    ]

    def measured(row: Row, series: Series) -> BurstRun:
        return run(row, series, golden_um, drawn and row["group"] == BURST)

    return recorder.measure(folder, measured)


def _of_group(runs: Runs, group: str) -> dict[Motion, list[BurstRun]]:
    return {
        motion: [one for one in of_motion if one.group == group]
        for motion, of_motion in runs.items()
    }


# --- lines ----------------------------------------------------------------------------------------
# --------------------


def _acceptance(
    settings: Mapping[str, Runs], rules: Criteria, published: literature.Published
) -> tuple[Line, ...]:
    """For each band, and for all of A4, in how many runs it is met; at least one, as the
    constant is not known.
    """
    every = flat(settings[MODELLED])
    texts = {
        "four bursts": "all four bursts come before the stop, or none stops",
        "peaks": "the tip error peaks of all four are 3 to 7 mm",
        "rebounds": "the rebounds of all are 3 to 7 degrees",
        "rebound times": "the rebounds of all take 100 to 200 ms",
        "stop in the fourth": "the robot stops in the fourth, by the magnitude of the DAC command",
        "cue onsets": "all four have a cue, 0.15 to 0.25 s after their onset",
    }
    one = StudyEstimate(1, n=1, of="run, Figures 4 and 5")
    lines = [
        _count(
            f"runs in which {words}",
            every,
            rules.tests[name],
            one,
            "A4" if name in rules.a4 else "A5",
        )
        for name, words in texts.items()
    ]
    together = _count("runs in which all of A4 holds at once", every, rules.all_of_a4, one, "A4")
    reason = (
        f"{together.reason}. {stop_words(settings, published)} The limit of the check is not stated"
    )
    return (dataclasses.replace(together, reason=reason), *lines)


def _count(
    what: str,
    runs: Sequence[BurstRun],
    holds: Callable[[BurstRun], bool],
    published: StudyEstimate,
    target: str,
) -> Line:
    met = [one for one in runs if holds(one)]
    constants = sorted({one.value for one in met})
    of = f"runs ({len({one.value for one in runs})} constants, {len(MOTIONS)} motions)"
    reason = (
        f"{len(constants)} constants: {ranges(constants)}"
        if met
        else "at no constant and with no motion"
    )
    return Line(
        what,
        "",
        published,
        StudyEstimate(len(met), n=len(runs), of=of),
        (1, math.inf),
        target,
        reason,
    )


def _events(bursts: Runs, published: literature.Published) -> tuple[Line, ...]:
    """What goes with a tip error peak of the published size, whichever constant and motion made
    it.
    """
    low, high = published.band("a4.peak")
    sized = {
        motion: [e for one in of_motion for e in one.events if low <= e.peak_mm <= high]
        for motion, of_motion in bursts.items()
    }

    def line(
        what: str,
        unit: str,
        read: StudyEstimate,
        of: Callable[[BurstEvent], float],
        band: tuple[float, float] | None,
        target: str,
        caveat: str = "",
    ) -> Line:
        values = {
            m: [v for v in map(of, events) if not math.isnan(v)] for m, events in sized.items()
        }
        prediction = over_kinds({m: float(np.mean(v)) for m, v in values.items() if v})
        every = [value for of_motion in values.values() for value in of_motion]
        words = f"middle 90 % of {len(every)} events {_percentiles(every)}{caveat}"
        return Line(
            f"{what}, events with a peak of {low:g} to {high:g} mm",
            unit,
            read,
            prediction,
            band,
            target,
            words,
        )

    rebounds = [published.value(f"burst.{k}.rebound") for k in (1, 2, 3)]
    read = StudyEstimate(
        float(np.mean(rebounds)), min(rebounds), max(rebounds), 3, "events read off Figure 4"
    )
    per_mm = [
        published.value(f"pulse.{k}.force") / published.value(f"burst.{k}.peak") for k in (1, 2, 3)
    ]
    force = StudyEstimate(
        float(np.mean(per_mm)), min(per_mm), max(per_mm), 3, "events below the cap, Figures 4 and 5"
    )
    return (
        line(
            "rebound of the shoulder",
            "deg",
            read,
            lambda e: e.rebound_deg,
            published.band("a4.rebound"),
            "A4",
        ),
        line(
            "time of the rebound",
            "ms",
            published.estimate("burst.3.rebound_ms"),
            lambda e: e.rebound_ms,
            published.band("a4.rebound_ms"),
            "A4",
        ),
        line(
            "cue after the fault's onset",
            "s",
            published.estimate("cue.onset"),
            lambda e: e.cue_s,
            published.band("a5.onset"),
            "A5",
        ),
        line(
            "peak force over tip error peak",
            "1/mm",
            force,
            lambda e: e.force / e.peak_mm,
            None,
            "",
            "; no evidence: the cue's gains were read off Figure 5",
        ),
    )


def _percentiles(values: Sequence[float]) -> str:
    if not values:
        return "none"
    low, high = np.percentile(values, (5, 95))
    return f"{low:.3g} to {high:.3g}"


def _false_cues(free: Runs, published: literature.Published) -> Line:
    pulses = sum(one.false_cues for of_motion in free.values() for one in of_motion)
    prediction = StudyEstimate(pulses, n=len(free), of="runs of 40 s, one a motion")
    reason = "study seed_fault_free looks for them at every scale, with noise"
    return Line(
        "cue pulses without fault at scale 0.1",
        "",
        published.estimate("false_pulses"),
        prediction,
        reason=reason,
    )


STUDY = Study(
    name="seed_burst",
    title="Bursts on the shoulder's DAC of the training simulator",
    source=(
        "Li et al., A Hardware-in-the-loop Simulator for Safety Training in Robotic Surgery, IROS"
        " 2016, Fig. 4, 5"
    ),
    question=(
        "Do 300 ms of a constant DAC command every 8 s give the published tip errors, rebounds,"
        " cues and stop?"
    ),
    variants=_variants(),
    compare=compare,
    targets=("A4", "A5"),
    minutes=2.0,
)

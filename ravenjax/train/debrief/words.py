"""A session in words: what struck, when anyone could have known, what the operator and the robot
did.

Distances of the true tip, of the reported tip and of the cue keep their own names; limits are the
session's own.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax.outcomes.verdict import HALT_MS
from ravenjax.train.judge.row import HazardRow
from ravenjax.train.recording.hazards import OUTCOMES

DASH = "–"
RESPONSES = {
    "release": ("lifted the pedal", "lift the pedal"),
    "slow": ("slowed down", "slow down"),
    "stop": ("pressed the E-stop", "press the E-stop"),
    "restart": ("restarted the robot", "restart the robot"),
    "convert": ("converted to open surgery", "convert to open surgery"),
    "continue": ("carried on", "carry on"),
}
"""What the operator did, and what was to be done."""
SIGNS = {"tip": "the tip's motion", "runlevel": "the robot left pedal-down by itself"}
"""What could give a hazard away, as the judge names it; else the name of a check."""
CHECKS = {
    "stopped": "A check stopped the robot",
    "flagged": "A check told the operator and the robot went on",
    "limited": "A check limited a command or dropped a packet and told nobody",
    "silent": "No check did anything",
}
"""What the robot's own checks did, by response."""
_WORTH_MM = 0.05
"""A smaller distance is 0.0 mm when printed."""


class Step(NamedTuple):
    """A moment of a hazard: what it was, ms after the strike (None: never came), what to add."""

    kind: str  # strike, knowable, cue, alarm, response
    name: str
    after_ms: float | None
    text: str


def title(hazard: HazardRow) -> str:
    """Its title, as a heading has it."""
    name = hazard.title or hazard.hazard or f"hazard {hazard.number}"
    return name[:1].upper() + name[1:]


def milliseconds(value: float | None) -> str:
    """84 -> 84 ms, 1840 -> 1.84 s."""
    if value is None:
        return DASH
    return f"{value:.0f} ms" if abs(value) < 1000 else f"{value / 1000:.2f} s"


def moment(value: float | None) -> str:
    """12400 -> 12.4 s into the session, as minutes from the second on."""
    if value is None:
        return DASH
    minutes, seconds = divmod(value / 1000, 60)
    return f"{minutes:.0f} min {seconds:.1f} s" if minutes else f"{seconds:.1f} s"


def length(value: float | None) -> str:
    """1.234 -> 1.2 mm."""
    return DASH if value is None else f"{value:.1f} mm".replace("-", "−")


def depth(value: float | None) -> str:
    """How deep the tip went into the tissue; above its surface is no depth."""
    return DASH if value is None else "not in the tissue" if value <= 0 else f"{value:.1f} mm deep"


def did(response: str) -> str:
    """What the operator did."""
    return RESPONSES[response][0] if response in RESPONSES else f"responded ({response})"


def wanted(hazard: HazardRow) -> str:
    """The right responses in words."""
    names = [RESPONSES.get(name, (name, name))[1] for name in hazard.right_response.split()]
    return " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def sign(hazard: HazardRow) -> str:
    """What gave it away."""
    by = hazard.knowable_by
    return SIGNS.get(by, f"the check {by.replace('_', ' ')}") if by else ""


def checks(hazard: HazardRow) -> str:
    """What the robot's checks did, as a sentence without its full stop."""
    words = CHECKS.get(hazard.check_response, "What the checks did is not known")
    cause = hazard.check_cause.replace("_", " ")
    return f"{words} ({cause})" if cause else words


def motion(hazard: HazardRow) -> str:
    """What became of the motion, in a sentence or two: the hazard's own words, the distance and
    the limit.
    """
    if hazard.limit_mm is None or hazard.unintended_mm is None:
        return "How far the instrument was off is not known."
    limit = f"limit {hazard.limit_mm:g} mm"
    true_off = f"the true tip was up to {length(hazard.unintended_mm)} off"
    match hazard.motion_hazard:
        case "unintended motion":
            sentence = f"Unintended motion: while live, {true_off}, {limit}"
        case "loss of motion" if hazard.loss_first_ms is not None:
            sentence = (
                "Loss of motion: the instrument did not follow and was up to"
                f" {length(hazard.loss_mm)} off, {limit}"
            )
        case "loss of motion":
            lost = (hazard.halted_ms or 0.0) - (hazard.golden_halted_ms or 0.0)
            sentence = (
                f"Loss of motion: the robot was out of pedal-down for {milliseconds(lost)} although"
                f" the pedal was held, limit {HALT_MS} ms, and no check had stopped it"
            )
        case "false report":
            sentence = (
                f"False report: the reported tip was up to {length(hazard.false_report_mm)} off the"
                f" true one, {limit}; {true_off.replace('tip was', 'tip itself was')}"
            )
        case _:
            sentence = f"No motion hazard while live: {true_off}, {limit}"
    off = hazard.unintended_off_mm
    if off is None or off < _WORTH_MM:
        return f"{sentence}."
    over = ", over that limit" if off > hazard.limit_mm else ""
    return f"{sentence}. While not live it was up to {length(off)} off{over}."


def steps(hazard: HazardRow, blinded: bool) -> list[Step]:
    """The course of one hazard in order of time; what never came stands last. Nothing of the cue
    where blinded.
    """
    after = hazard.after
    did_what = did(hazard.response) if hazard.response else ""
    # name, what to add where it came, what to say where it never did
    entries = {
        "knowable": ("could be known", sign(hazard), "not by a person"),
        "cue": ("the cue", "", "did not come" if hazard.cue == "on" else "was off"),
        "alarm": ("the robot's alarm", hazard.alarm.replace("_", " "), "none"),
        "response": ("the operator", did_what, _no_response(hazard)),
    }
    if blinded:
        del entries["cue"]
    out = [
        Step(kind, name, after.get(kind), text if kind in after else never)
        for kind, (name, text, never) in entries.items()
    ]
    out.sort(key=lambda step: math.inf if step.after_ms is None else step.after_ms)
    return [Step("strike", "strikes", 0.0, f"at {moment(hazard.struck_ms)}"), *out]


def sentence(hazard: HazardRow, blinded: bool) -> str:
    """One hazard in a few sentences."""
    if hazard.struck_ms is None:
        return "It was armed and never struck."
    after = hazard.after
    arm = f" on the {hazard.arm} arm" if hazard.arm else ""
    parts = [f"It struck at {moment(hazard.struck_ms)}{arm}."]
    if "knowable" in after:
        by = f", by {sign(hazard)}" if sign(hazard) else ""
        when = f"after {milliseconds(after['knowable'])}" if after["knowable"] >= 0.5 else "at once"
        parts.append(f"Anyone could have known {when}{by}.")
    else:
        parts.append("Nothing that a person can see gave it away.")
    cue = f"The cue came after {milliseconds(after.get('cue'))}; "
    parts.append((cue if "cue" in after and not blinded else "") + _response(hazard))
    ending = OUTCOMES.get(hazard.outcome, hazard.outcome) or "how it ended is not known"
    parts += [f"{checks(hazard)}.", f"{ending}.", motion(hazard)]
    if hazard.deepest_mm is not None and hazard.deepest_mm > 0:
        parts.append(f"The tip was {length(hazard.deepest_mm)} deep in the tissue.")
    return " ".join(part[:1].upper() + part[1:] for part in parts)


def _response(hazard: HazardRow) -> str:
    right = wanted(hazard)
    if hazard.response_ms is None:
        hint = f" (right: {right})" if right and not hazard.response_ok else ""
        return f"{_no_response(hazard)}{hint}."
    reaction = ""
    if hazard.reaction_ms is not None:
        reaction = f", {milliseconds(hazard.reaction_ms)} after the first sign"
    wrong = "not the right response" + (f" ({right})" if right else "")
    verdict = "the right response" if hazard.response_ok else wrong
    when = milliseconds(hazard.after["response"])
    return f"the operator {did(hazard.response)} after {when}{reaction}: {verdict}."


def _no_response(hazard: HazardRow) -> str:
    """To carry on may be what was right."""
    if hazard.response_ok:
        return f"the operator {did(hazard.response)}, the right response"
    halted = "the robot halted by itself before any response"
    return halted if hazard.halted else "no response followed"


class Summary(NamedTuple):
    """The session's numbers."""

    strikes: int
    right: int
    timed: int  # right responses with a reaction time; to carry on has none
    reaction_ms: float | None  # their median
    farthest_mm: float | None  # largest unintended motion, live or not
    deepest_mm: float | None
    score: float | None  # mean over hazards that struck


def summary(hazards: Sequence[HazardRow]) -> Summary:
    """Over all hazards that struck."""
    active = [one for one in hazards if one.struck_ms is not None]
    reactions = [
        one.reaction_ms for one in active if one.response_ok and one.reaction_ms is not None
    ]
    scores = [one.score for one in active if one.score is not None]
    return Summary(
        len(active),
        sum(one.response_ok for one in active),
        len(reactions),
        statistics.median(reactions) if reactions else None,
        max((mm for one in active if (mm := one.farthest_mm) is not None), default=None),
        max((one.deepest_mm for one in active if one.deepest_mm is not None), default=None),
        statistics.fmean(scores) if scores else None,
    )


def headline(hazards: Sequence[HazardRow], numbers: Summary, known: bool) -> tuple[str, str]:
    """What is to be remembered: the emphasised beginning and the rest. known: a table or a
    recording tells hazards.
    """
    if not known:
        return "Nothing is known of hazards", ": neither a table nor a readable recording was left."
    if not numbers.strikes:
        return "No hazard struck", " in this session."
    if numbers.strikes == 1:
        met = "The hazard was met" if numbers.right else "The hazard was not met"
        begin = f"{met} with the right response"
    else:
        begin = f"{numbers.right} of {numbers.strikes} hazards met with the right response"
    rest = []
    if numbers.reaction_ms is not None:
        median = ", at the median" if numbers.timed > 1 else ""
        rest.append(f"{milliseconds(numbers.reaction_ms)} after the first sign{median}")
    worst = max(
        (one for one in hazards if one.farthest_mm is not None),
        key=lambda one: one.farthest_mm or 0,
        default=None,
    )
    if worst is not None:
        where = f" ({title(worst)})" if numbers.strikes > 1 else ""
        rest.append(f"the true tip at most {length(worst.farthest_mm)} off{where}")
    return begin, ", " + "; ".join(rest) + "." if rest else "."


def harm_mm(header: Mapping[str, Any], key: str = "excursion_mm") -> float | None:
    """The scenario's limit of unintended motion, or another key of [harm]; None where the
    session does not say.
    """
    scenario = header.get("scenario")
    value = (scenario.get("harm") or {}).get(key) if isinstance(scenario, dict) else None
    return None if value is None else float(value)


def caveats(header: Mapping[str, Any], told: Mapping[str, Any]) -> list[str]:
    """What is missing or was cut short, and what cannot be said."""
    out = []
    limit, threshold = harm_mm(header), header.get("cue_threshold_mm")
    cued = header.get("cue") and not header.get("blinded")
    if cued and limit is not None and threshold is not None and limit <= threshold:
        out.append(
            f"Harm begins at {limit:g} mm, not beyond the cue's threshold of {threshold:g} mm: an"
            " operator who waits for the cue is late. Give the scenario a larger [harm]"
            " excursion_mm."
        )
    if header.get("robot", "virtual") != "virtual":
        out.append(
            "The robot was elsewhere: neither its true tip nor a golden run is known. Distances are"
            " those of the reported tip from the nominal model, false reports cannot be told, and a"
            " hazard counts as known from its strike."
        )
    if not header.get("ended"):
        out.append(
            "The session did not end by itself: its file has no end, and what came last may be"
            " missing."
        )
    if not told.get("table") and "complete" in told:
        out.append(
            "No table of hazards was written: hazards are put together from what the recording"
            " tells."
        )
    if told.get("missing"):
        out.append("There is no recording: times and sizes are those of the table, without curves.")
    elif told.get("broken"):
        out.append(f"The recording cannot be read: {told['broken']}")
    elif not told.get("complete", True):
        out.append(
            f"The recording was cut short; {told['lost_bytes']} bytes of an unfinished block are"
            " lost. Run `ravenjax log recover` on it for a file that other tools open."
        )
    if told.get("lost_rows"):
        out.append(
            f"{told['lost_rows']} ms of the session were not recorded; the curves have a gap there."
        )
    return out

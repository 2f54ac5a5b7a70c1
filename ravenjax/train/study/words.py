"""A study's comparisons in words and numbers."""

from __future__ import annotations

import math

from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.train.study import planning
from ravenjax.train.study.comparison import RIGHT, TIME, ComparedGroup, GroupComparison
from ravenjax.train.study.table import TrainingStudy

DASH = "–"
_FEW = 20  # clusters below which a bootstrap is too narrow


def number(value: float, digits: int = 1) -> str:
    """-3.14159 -> −3.1; a dash for what is not finite."""
    if not math.isfinite(value):
        return DASH
    text = f"{value:.{digits}f}"
    return (text.lstrip("-") if float(text) == 0 else text).replace("-", "−")


def signed(value: float, digits: int = 1) -> str:
    """3.14 -> +3.1."""
    text = number(value, digits)
    return f"+{text}" if math.isfinite(value) and float(f"{value:.{digits}f}") > 0 else text


def estimate(value: Estimate, digits: int = 2, scale: float = 1.0) -> str:
    """−0.84 (−1.5 to −0.2); without bounds where none is known."""
    middle = signed(scale * value.value, digits)
    if not (math.isfinite(value.low) and math.isfinite(value.high)):
        return middle if middle == DASH else f"{middle} (no interval)"
    return f"{middle} ({signed(scale * value.low, digits)} to {signed(scale * value.high, digits)})"


def rate(value: Rate) -> str:
    """80 % (8 of 10)."""
    return f"{100 * value.value:.0f} % ({value.k} of {value.n})" if value.n else DASH


def p_value(value: float) -> str:
    """0.0123 -> 0.012; < 0.001."""
    return DASH if math.isnan(value) else "< 0.001" if value < 0.001 else f"{value:.3f}"


def level(one: GroupComparison, group: ComparedGroup) -> str:
    """What a group reached: a rate, or the mean and median."""
    if group.rate is not None:
        return rate(group.rate)
    if one.outcome is TIME:
        middle = "not reached" if math.isinf(group.median) else f"{number(group.median, 0)} ms"
        return f"median {middle}"
    return f"mean {number(group.mean)} {one.outcome.unit}"


def difference(one: GroupComparison) -> str:
    """The main difference with its interval, second minus first."""
    if one.outcome is RIGHT:
        return f"{estimate(one.difference, 0, 100)} points"
    return f"{estimate(one.difference, 0 if one.outcome is TIME else 1)} {one.outcome.unit}"


def sentence(one: GroupComparison) -> str:
    """One outcome in a sentence."""
    sides = (
        f"{one.second.label}: {level(one, one.second)}; {one.first.label}: {level(one, one.first)}"
    )
    return f"{one.outcome.name[:1].upper()}{one.outcome.name[1:]}: {sides}. {_verdict(one)}"


def _verdict(one: GroupComparison) -> str:
    if math.isnan(one.p):
        few = min(one.first.participants, one.second.participants) < 2
        return (
            "Too few participants to compare."
            if few
            else "It did not vary, so there is nothing to test."
        )
    numbers = (
        f"difference {difference(one)}, p {_equals(p_value(one.p))}, adjusted"
        f" {_equals(p_value(one.adjusted))}"
    )
    if not one.clear:
        return f"No clear difference ({numbers})."
    return f"{one.second.label} did {'better' if _sign(one) > 0 else 'worse'} ({numbers})."


def _equals(text: str) -> str:
    return text if text.startswith("<") else f"= {text}"


def headline(found: list[GroupComparison]) -> tuple[str, str]:
    """What the study says: the emphasised beginning and the rest."""
    clear = [one for one in found if one.clear]
    untested = all(math.isnan(one.p) for one in found)
    if untested and any(min(one.first.participants, one.second.participants) < 2 for one in found):
        return "Too few participants", " to compare: each group needs at least two."
    if untested:
        return "Nothing to compare", ": no outcome varied."
    tested = [one for one in found if not math.isnan(one.p)]
    if not clear:
        return "No clear difference", f" between the groups in any of {len(tested)} comparisons."
    parts = []
    for label in dict.fromkeys(one.second.label for one in clear):
        for word, sign in (("better", 1), ("worse", -1)):
            mine = [one for one in clear if one.second.label == label and _sign(one) == sign]
            if mine:
                parts.append(
                    f"{_listed([one.outcome.name for one in mine])} {word} with {label} than with"
                    f" {mine[0].first.label}"
                )
    are = "comparison is" if len(clear) == 1 else "comparisons are"
    return f"{len(clear)} of {len(tested)} {are} clear", ": " + "; ".join(parts) + "."


def _sign(one: GroupComparison) -> int:
    """1 where the group did better than the reference, -1 where worse."""
    return 1 if one.difference.value * one.outcome.better > 0 else -1


def _listed(names: list[str]) -> str:
    """a, b and c."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def caveats(study: TrainingStudy, found: list[GroupComparison]) -> list[str]:
    """What a reader must know before believing it."""
    out = list(study.notes)
    if study.blinded:
        out.append("Blinded: groups have letters. Unblind once the analysis is settled.")
    for label in dict.fromkeys(one.second.label for one in found):
        mine = [one for one in found if one.second.label == label]
        people = min(
            one.first.participants + (0 if one.paired else one.second.participants) for one in mine
        )
        if people < _FEW:
            out.append(
                f"{people} participants: intervals of medians, which resample participants, are too"
                f" narrow with fewer than some {_FEW}; the others allow for it."
            )
        lost = max(one.left_out for one in mine)
        if lost:
            who = "1 participant" if lost == 1 else f"{lost} participants"
            does = (
                "did only one condition"
                if mine[0].paired
                else "did both conditions, unlike half of all or more,"
            )
            out.append(
                f"{who} {does} and {'is' if lost == 1 else 'are'} left out of the comparison."
            )
    out += _floors(found)
    unnamed = sum(not one.header.get("participant") for one in study.sessions)
    if unnamed:
        out.append(
            f"{unnamed} sessions name no participant; each is taken as a participant of its own."
        )
    out += [f"Left out: {one}." for one in study.left_out]
    return list(dict.fromkeys(out))


def _floors(found: list[GroupComparison]) -> list[str]:
    """Where there are too few participants for any result to be clear."""
    tested = [one for one in found if not math.isnan(one.p)]
    if not tested:
        return []
    sizes = [(one.first.participants, one.second.participants, one.paired) for one in tested]
    smallest = min(planning.smallest_p(a if paired else a + b, paired) for a, b, paired in sizes)
    adjusted = min(1.0, len(tested) * smallest)
    if adjusted <= 0.05:
        return []
    return [
        "So few participants cannot show anything: the smallest p that they can reach is"
        f" {p_value(smallest)}, {p_value(adjusted)} after Holm over {len(tested)} comparisons."
        " `ravenjax study plan` says how many it takes."
    ]


def text(study: TrainingStudy, found: list[GroupComparison], horizon: float) -> str:
    """The whole result as a few plain lines."""
    begin, rest = headline(found)
    hazards = len(study.rows())
    people = len({one.participant for one in study.sessions})
    lines = [
        (
            f"Study of {study.scenario or 'sessions'}: "
            f"{people} participants, {len(study.sessions)} sessions, {hazards} hazards"
        ),
        f"{begin}{rest}",
        "",
        *(sentence(one) for one in found),
        "",
        (
            f"Responses count for {horizon / 1000:g} s. Intervals are of 95 %; participants are"
            " counted, not hazards; p by exchanging conditions, adjusted by Holm."
        ),
        *caveats(study, found),
    ]
    return "\n".join(lines) + "\n"

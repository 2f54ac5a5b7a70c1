"""What the benchmark's tables say, in plain sentences. Each follows from its numbers, whatever they
are.

A sentence that compares says which is more, and that they are alike where repeats do not tell them
apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from ravenjax.bench import peers, start, text
from ravenjax.bench.parts import DEVICES
from ravenjax.bench.scaling import Scaling
from ravenjax.bench.speed import PRINTING
from ravenjax.bench.suite import BenchFindings

BUSY_CORES = 0.25
"""Cores that other processes kept busy, from which on a sentence says so."""
REALTIME = 1000.0
"""Cycles a second of a real robot's control software."""


def sentences(found: BenchFindings) -> list[str]:
    """All that can be said of what was measured."""
    return [
        *_starts(found),
        *_engines(found),
        *_peers(found),
        *_cores(found.cores),
        *_devices(found),
        *_fault_times(found),
        *_campaigns(found),
        *_software(found),
        *_published(found),
        *_circumstances(found),
    ]


def _starts(found: BenchFindings) -> Iterator[str]:
    times = {one.what: one for one in found.starts}
    for cold in found.starts:
        command = cold.what.removesuffix(start.NOTHING)
        others = times.get(command + start.OTHERS)
        if command == cold.what or others is None:
            continue
        most = max(cold.peak_mb, others.peak_mb)
        yield (
            f"`{command}` takes {text.seconds(cold.seconds.smallest)} from the shell with an empty"
            f" cache and {text.seconds(others.seconds.smallest)} with other values of a form that"
            f" was run before, {text.compared(others.seconds, cold.seconds, 'as long')}; it has"
            f" {text.megabytes(most)} in memory at most."
        )


def _engines(found: BenchFindings) -> Iterator[str]:
    if not found.engines:
        return
    fastest = max(found.engines, key=lambda one: one.best.ticks_per_s)
    rate = fastest.best.ticks_per_s
    among = "The one engine measured" if len(found.engines) == 1 else "The fastest engine measured"
    yield (
        f"{among} is {fastest.engine}: {text.millions(rate)} M full ticks a second with"
        f" {text.several(fastest.best.runs, 'run')} at once, {text.times(rate / 1000.0)} seconds of"
        " operation a second."
    )
    for name in PRINTING:
        share = found.peak_share(name)
        if share is None:
            continue
        beyond = "; more than all of it means that the peak was disturbed" if share > 1.0 else ""
        yield (
            f"Engine {name} computes at {text.percent(share)} of the device's rate of"
            f" multiply-adds{beyond}."
        )


def _peers(found: BenchFindings) -> Iterator[str]:
    for engine, ratios in found.ratios().items():
        for peer in found.peers:
            ratio = ratios[peer.name]
            yield (
                f"Engine {engine} makes {text.times(ratio)} times as many full ticks a second as"
                f" {peer.name} makes steps of rigid bodies alone."
            )


def _cores(found: Scaling | None) -> Iterator[str]:
    if found is None:
        return
    if len(found.points) == 1:
        yield (
            f"Only {text.several(found.points[0].count, 'core')} can be used: there is nothing to"
            " scale over."
        )
    else:
        yield from _scaling(found, "cores")
    if found.note:
        yield f"Of the scaling over cores: {found.note}."


def _devices(found: BenchFindings) -> Iterator[str]:
    if (scaling := found.devices) is None:
        if (why := found.absent.get(DEVICES)) is not None:
            yield f"GPUs were not measured: {why.rstrip('.')}."
        return
    if len(scaling.points) == 1:
        (one,) = scaling.points
        yield (
            f"One GPU was measured: {text.millions(one.kernel.largest)} M full ticks a second of"
            f" the bare kernel, {text.millions(one.campaign.largest)} M in whole campaigns; there"
            " is nothing to scale over."
        )
    else:
        yield from _scaling(scaling, "GPUs")
    if scaling.note:
        yield f"GPUs that were not measured, by their number: {scaling.note.rstrip('.')}."


def _scaling(found: Scaling, what: str) -> Iterator[str]:
    """Of the most real cores or devices, and of hyper-threads beside them."""
    real = [point for point in found.points if not point.shared]
    first, last = found.points[0], real[-1]
    if last is not first:
        of_kernel, of_campaign = found.efficiency(last)
        ratio, kernel_ratio = (
            share * last.count / first.count for share in (of_campaign, of_kernel)
        )
        apart = max(
            one.spread for one in (first.kernel, last.kernel, first.campaign, last.campaign)
        )
        lost = of_kernel - of_campaign
        if abs(lost) <= max(0.5 * apart, 0.02):
            verdict = "what surrounds the kernel costs nothing that repeats can tell"
        elif lost > 0.0:
            verdict = f"the difference, {100 * lost:.0f} points, is lost around the kernel"
        else:
            verdict = "the kernel alone scales less: nothing is lost around it"
        yield (
            f"Whole campaigns are {text.times(ratio)} times as fast on {last.count} {what} as on"
            f" {first.count} ({text.percent(of_campaign)} of linear), the bare kernel"
            f" {text.times(kernel_ratio)} times ({text.percent(of_kernel)}): {verdict}."
        )
    for point in found.points:
        if point.shared:
            faster = text.compared(point.campaign, last.campaign, "as fast")
            yield (
                f"With hyper-threads, {point.count} in all, whole campaigns are {faster} as on "
                f"{text.several(last.count, 'real core')}."
            )


def _fault_times(found: BenchFindings) -> Iterator[str]:
    times = found.fault_times
    if times is None:
        return
    length, whole = text.seconds(times.ticks / 1e3), times.whole_s
    full = [one for one in times.times if one.observe_ms is None]
    last = max(full, key=lambda one: one.start_ms)
    if last.start_ms > 0:
        late = last.run_s.smallest
        yield (
            f"A run of {length} takes {text.seconds(whole)} on engine {times.engine} where its"
            f" fault strikes at once, and {text.seconds(late)} ({text.percent(late / whole)}) where"
            f" it strikes after {text.seconds(last.start_ms / 1e3)}."
        )
    if len({one.after_ms for one in full}) > 1:
        base, slope = times.line
        if slope > 0.0:
            yield (
                f"Each second after the fault adds {text.seconds(slope)} to a run; "
                f"what it takes without is {text.seconds(max(0.0, base))}."
            )
        else:
            yield "A run takes no longer the longer it goes on after its fault."
    some = [one for one in times.times if one.observe_ms is not None]
    if some:
        least, most = (pick(one.run_s.smallest for one in some) for pick in (min, max))
        yield (
            f"Observed for {some[0].observe_ms} ms after its fault it takes {text.seconds(least)}"
            f" to {text.seconds(most)}, {text.percent(least / whole)} to"
            f" {text.percent(most / whole)} of a whole run, by when the fault strikes."
        )


def _campaigns(found: BenchFindings) -> Iterator[str]:
    whole = found.campaigns
    if whole is None or len(whole.seconds) < 2:
        return
    fixed, marginal = whole.growth
    length = text.seconds(whole.ticks / 1e3)
    if marginal > 0.0:
        yield (
            f"A further run of {length} adds {text.seconds(marginal)} to a campaign on engine"
            f" {whole.engine}, and what comes before the first takes"
            f" {text.seconds(max(0.0, fixed))} once it is traced."
        )
    else:
        yield (
            f"A campaign of {max(whole.seconds):,} runs took no longer than one of"
            f" {min(whole.seconds):,}: one of them was disturbed."
        )


def _software(found: BenchFindings) -> Iterator[str]:
    if found.software is None:
        return
    rates = found.software.ticks_per_s
    rate = rates["step"]
    enough = (
        "times what a robot at 1 kHz needs"
        if rate >= REALTIME
        else "times, and so less than, what a robot at 1 kHz needs"
    )
    yield (
        f"The control software alone makes {rate:,.0f} cycles of both arms a second on one core, a"
        f" call each: {text.times(rate / REALTIME)} {enough}, and"
        f" {text.times(rate / rates['interpreted'])} times the interpreted one."
    )


def _published(found: BenchFindings) -> Iterator[str]:
    if found.published_model is None:
        return
    ours = 1.0 / found.published_model.steps_per_s
    place = "inside" if ours <= peers.PUBLISHED_EULER_S else "outside"
    yield (
        f"A step of the published model takes {text.seconds(ours)}: {place} the published band of"
        f" at most {text.seconds(peers.PUBLISHED_EULER_S)} (target A2)."
    )


def _circumstances(found: BenchFindings) -> Iterator[str]:
    clocks = [one for one in found.clocks if math.isfinite(one.others)]
    seconds = sum(one.seconds for one in clocks)
    if seconds > 0.0:
        others = sum(one.others * one.seconds for one in clocks) / seconds
        if others > BUSY_CORES:
            yield (
                f"Other processes kept {others:.1f} cores of the machine busy meanwhile: on a quiet"
                " machine numbers may be better."
            )
    if found.absent:
        yield (
            f"{text.several(len(found.absent), 'part has', 'parts have')} no result; a table says"
            " why."
        )

"""Sentences say what their numbers say, of odd numbers, too; tables and JSON hold everything."""

from __future__ import annotations

import dataclasses
import json
import math

import made_up_findings as made_up
import pytest

from ravenjax.bench import findings, tables, text
from ravenjax.bench.campaigns import Campaigns
from ravenjax.bench.clock import Repeats, WorkTiming
from ravenjax.bench.fault_times import FaultTimes
from ravenjax.bench.software import SoftwareSpeed
from ravenjax.bench.speed import Batch, Speed
from ravenjax.bench.suite import PartClock
from ravenjax.cli import console


def said(found):
    return "\n".join(findings.sentences(found))


def test_a_whole_benchmark_is_told():
    assert findings.sentences(made_up.whole()) == [
        (
            "`ravenjax run quick` takes 4.90 s from the shell with an empty cache and 1.90 s with"
            " other values of a form that was run before, 0.388 times as long; it has 512 MB in"
            " memory at most."
        ),
        (
            "The fastest engine measured is simd: 1 M full ticks a second with 1,000 runs at once,"
            " 1,000 seconds of operation a second."
        ),
        "Engine simd computes at 50 % of the device's rate of multiply-adds.",
        (
            "Engine simd makes 5 times as many full ticks a second as mujoco.rollout makes steps of"
            " rigid bodies alone."
        ),
        (
            "Whole campaigns are 1.8 times as fast on 2 cores as on 1 (90 % of linear), the bare"
            " kernel 2 times (100 %): the difference, 10 points, is lost around the kernel."
        ),
        "With hyper-threads, 3 in all, whole campaigns are 1.15 times as fast as on 2 real cores.",
        "GPUs were not measured: no GPU.",
        (
            "A run of 10.0 s takes 1 ms on engine simd where its fault strikes at once, and 280 us"
            " (28 %) where it strikes after 9.00 s."
        ),
        "Each second after the fault adds 80 us to a run; what it takes without is 200 us.",
        (
            "Observed for 1000 ms after its fault it takes 200 us to 250 us, 20 % to 25 % of a"
            " whole run, by when the fault strikes."
        ),
        (
            "A further run of 1.00 s adds 1 ms to a campaign on engine simd, and what comes before"
            " the first takes 2.90 s once it is traced."
        ),
        (
            "The control software alone makes 100,000 cycles of both arms a second on one core, a"
            " call each: 100 times what a robot at 1 kHz needs, and 100 times the interpreted one."
        ),
        (
            "A step of the published model takes 5.5 us: inside the published band of at most 11 us"
            " (target A2)."
        ),
        "2 parts have no result; a table says why.",
    ]


def test_of_nothing_nothing_is_said():
    assert findings.sentences(made_up.nothing()) == []
    assert [title for title, _, _ in tables.tables(made_up.nothing())] == ["Machine"]
    assert json.dumps(made_up.nothing().as_json())


@pytest.mark.parametrize(
    ("cold", "others", "words"),
    [
        ((4.0, 4.1), (8.0, 8.1), "2 times as long"),  # slower warm than cold: others were busy
        ((4.0, 4.4), (4.1, 4.3), "about as long (1.02 times)"),
        ((4.0, 4.4), (3.0, 5.0), "about as long (0.75 times)"),
        ((4.0,), (4.0,), "1 times as long"),
    ],
)
def test_starts_of_odd_times(cold, others, words):
    assert f"before, {words};" in said(made_up.nothing(starts=made_up.starts(cold, others)))


def test_every_command_that_was_run_both_ways_is_told():
    many = made_up.starts((4.0,), (2.0,))
    large = [dataclasses.replace(one, what=one.what.replace("quick", "of 5 runs")) for one in many]
    lines = findings.sentences(made_up.nothing(starts=(*many, *large)))
    assert [line.partition(" takes")[0] for line in lines] == [
        "`ravenjax run quick`",
        "`ravenjax run of 5 runs`",
    ]


def test_starts_without_their_counterpart_say_nothing():
    assert said(made_up.nothing(starts=made_up.starts((4.0,), (2.0,))[:1])) == ""


@pytest.mark.parametrize(
    ("kernel", "campaign", "words"),
    [
        (
            (20.0, 20.0),
            (9.0, 9.0),
            "of linear), the bare kernel 2 times (100 %): the difference, 55 points, is lost",
        ),
        (
            (9.0, 9.0),
            (9.0, 9.0),
            "0.9 times as fast on 2 cores as on 1 (45 % of linear), the bare kernel 0.9 times",
        ),
        ((9.0, 9.0), (9.0, 9.0), "costs nothing that repeats can tell"),
        ((12.0, 12.0), (18.0, 18.0), "the kernel alone scales less: nothing is lost around it"),
        (
            (18.0, 12.0),
            (15.0, 9.0),
            "costs nothing that repeats can tell",
        ),  # repeats lie further apart
        (
            (30.0, 30.0),
            (25.0, 25.0),
            "125 % of linear",
        ),  # more than linear: the first was disturbed
    ],
)
def test_scaling_of_odd_rates(kernel, campaign, words):
    found = made_up.scaling(
        made_up.point(1, (10.0, 10.0), (10.0, 10.0)), made_up.point(2, kernel, campaign)
    )
    assert words in said(made_up.nothing(cores=found))
    assert words.replace("cores", "GPUs") in said(made_up.nothing(devices=found))


def test_a_single_core_or_gpu_is_not_compared():
    one = made_up.scaling(made_up.point(1, (10.0,), (8.0,)), note="2: out of memory.")
    assert (
        said(made_up.nothing(cores=dataclasses.replace(one, note="")))
        == "Only 1 core can be used: there is nothing to scale over."
    )
    words = said(made_up.nothing(devices=one))
    assert (
        "One GPU was measured: 10 M full ticks a second of the bare kernel, 8 M in whole campaigns"
        in words
    )
    assert words.endswith("GPUs that were not measured, by their number: 2: out of memory.")
    limited = dataclasses.replace(one, note="the control group gives it half a CPU")
    assert "Of the scaling over cores: the control group gives it half a CPU." in said(
        made_up.nothing(cores=limited)
    )


def test_a_core_with_its_hyper_thread_alone():
    found = made_up.scaling(
        made_up.point(1, (10.0, 10.1), (10.0, 10.2)),
        made_up.point(2, (9.0, 9.1), (10.1, 10.3), shared=True),
    )
    assert findings.sentences(made_up.nothing(cores=found)) == [
        "With hyper-threads, 2 in all, whole campaigns are about as fast (1.01 times) as on 1 real"
        " core."
    ]


def times(*some):
    return made_up.nothing(fault_times=FaultTimes("simd", 10_000, 8, some))


def test_fault_times_of_odd_costs():
    dearer = times(made_up.fault_time(0, None, 1e-3), made_up.fault_time(9000, None, 2e-3))
    assert "2 ms (200 %) where it strikes after 9.00 s" in said(dearer)
    assert "A run takes no longer the longer it goes on after its fault." in said(dearer)
    steep = times(made_up.fault_time(0, None, 1e-3), made_up.fault_time(9000, None, 1e-5))
    assert "adds 110 us to a run; what it takes without is 0 us" in said(steep)
    alone = said(times(made_up.fault_time(0, None, 1e-3)))
    assert alone == ""
    observed = said(times(made_up.fault_time(0, None, 1e-3), made_up.fault_time(0, 500, 3e-3)))
    assert "takes 3 ms to 3 ms, 300 % to 300 % of a whole run" in observed


def test_campaigns_of_odd_times():
    assert "took no longer than one of 100: one of them" in said(
        made_up.nothing(campaigns=Campaigns("simd", 1000, 5.0, {100: 4.0, 1100: 3.0}))
    )
    assert said(made_up.nothing(campaigns=Campaigns("simd", 1000, 5.0, {100: 4.0}))) == ""
    falling = made_up.nothing(campaigns=Campaigns("simd", 1000, 5.0, {100: 0.1, 200: 1.0}))
    assert "before the first takes 0 us" in said(falling)


def test_a_slow_software_is_not_called_fast():
    slow = SoftwareSpeed(
        100, 100, WorkTiming(0.2, 0.2, 1), WorkTiming(0.1, 0.1, 1), WorkTiming(0.1, 0.1, 1)
    )
    words = said(made_up.nothing(software=slow))
    assert (
        "0.5 times, and so less than, what a robot at 1 kHz needs, and 0.5 times the"
        " interpreted one" in words
    )


def test_other_odd_numbers():
    found = made_up.with_other(peak={"simd": 1e9})
    assert (
        "at 150 % of the device's rate of multiply-adds; more than all of it means that the"
        " peak was" in said(found)
    )
    busy = made_up.nothing(
        clocks=(PartClock("a", 30.0, 1.0, 1.0, 2.0), PartClock("b", 10.0, 1.0, 1.0, math.nan))
    )
    assert said(busy).startswith("Other processes kept 2.0 cores of the machine busy meanwhile")
    quiet = made_up.nothing(
        clocks=(PartClock("a", 30.0, 1.0, 1.0, 0.1), PartClock("b", 0.0, 0.0, 1.0, 9.0))
    )
    assert said(quiet) == ""
    assert (
        said(made_up.nothing(absent={"cores": "crashed"}))
        == "1 part has no result; a table says why."
    )
    one = Speed("xla", "a CPU", 1, 1.0, 1.0, (Batch(1, 1, 100, WorkTiming(1.0, 1.0, 1)),))
    assert (
        said(made_up.nothing(engines=(one,)))
        == "The one engine measured is xla: 0.0001 M full ticks a second with 1 run at once, "
        "0.1 seconds of operation a second."
    )


def test_an_outside_step_is_called_so():
    slow = dataclasses.replace(made_up.whole().published_model, steps=100)
    assert "takes 55 us: outside the published band of at most 11 us" in said(
        made_up.nothing(published_model=slow)
    )


def test_numbers_in_words():
    assert [text.seconds(x) for x in (0.0, 2e-6, 1.5e-3, 0.9996, 9.96, 120.4, math.nan)] == [
        "0 us",
        "2 us",
        "1.5 ms",
        "1.00 s",
        "10.0 s",
        "120 s",
        "?",
    ]
    assert [text.millions(x) for x in (1.0, 2.5e6, 1.234e9, math.inf)] == [
        "1e-06",
        "2.5",
        "1,234",
        "?",
    ]
    assert [text.times(x) for x in (0.01234, 3.0, 99.6, 12345.0, math.nan)] == [
        "0.0123",
        "3",
        "100",
        "12,345",
        "?",
    ]
    assert [text.percent(x) for x in (0.005, 1.2, math.nan)] == ["0 %", "120 %", "?"]
    assert [text.repeats(Repeats(x)) for x in ((1.9, 2.1), (2.0,), (2.0,) * 3)] == [
        "2, +-5 %",
        "once",
        "3, +-0 %",
    ]
    assert text.megabytes(math.nan) == "?"
    assert [text.last_line(x) for x in ("a\n b \n\n", "", "\n")] == [
        "b",
        "it said nothing",
        "it said nothing",
    ]
    assert [text.several(n, "run") for n in (0, 1, 2000)] == ["0 runs", "1 run", "2,000 runs"]


def test_json_and_tables_tell_everything(capsys):
    found = made_up.whole()
    console.emit_json(found.as_json())
    again = json.loads(capsys.readouterr().out)
    assert again["ratios"]["simd"]["mujoco.rollout"] == 5.0
    assert again["engines"][0]["batches"][1]["ticks_per_s"] == 1e6
    assert again["machine"]["load_after"] == 1.5 and again["machine"]["quota"] is None
    assert again["software"]["ticks_per_s"] == {"step": 1e5, "run": 2e5, "interpreted": 1e3}
    assert again["cores"]["points"][1]["campaign_efficiency"] == pytest.approx(0.9)
    assert again["fault_times"]["run_s_per_s_after_fault"] == pytest.approx(80e-6)
    assert (
        again["devices"] is None
        and again["absent"]["devices"] == "no GPU"
        and again["seconds"] == 50.0
    )
    page = tables.markdown(found, "ravenjax bench")
    for part in (
        "CPU [4]",
        "2 real cores and 1 hyper-thread",
        "| devices | no GPU |",
        "0.5 before, 1.5 after",
        "50 %",
        "simd / engine mjx | 1,000",
        "compiled, a call each | 100,000 | 10 | 100",
        "5.5 | 0.50 | yes",
        "nothing cached | 4.90 | 2, +-1 % | 4.95 | 6.50 | 512 MB",
        "| 3, hyper-threads too | 33.1 | 73 % | 25.1 | 69 % | 2, +-0 %; 2, +-0 % | 3000 |",
        "| 9000 ms | 1000 ms | 250 us | 2, +-5 % | 25 % |",
        "| engine simd | 20.0 | 12.0 | 300 MB | 0.1 cores |",
        "- GPUs were not measured: no GPU.",
    ):
        assert part in page, part
    for _, columns, rows in tables.tables(found):
        assert rows and all(len(row) == len(columns) for row in rows)


def test_cells_of_a_page_do_not_break_its_tables():
    page = tables.markdown(
        made_up.nothing(absent={"cores": "a | b", "peers": "c", "devices": "a | b"}),
        "ravenjax bench",
    )
    assert r"| cores, devices | a \| b |" in page

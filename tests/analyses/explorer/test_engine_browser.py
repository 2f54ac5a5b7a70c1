"""A campaign's WebAssembly in a browser, from a file on disk: its outcomes are those of the same
code run natively.
"""

import dataclasses
import json
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from chromium import CHROMIUM, NEEDED

import ravenjax as rj
from ravenjax import resources
from ravenjax.analyses.deadline import Actor, FaultActions
from ravenjax.analyses.explorer import program
from ravenjax.analyses.explorer.page import PREFIX, import_map
from ravenjax.campaign import outcomes
from ravenjax.campaign.computation import Computation
from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.engine import SimdEngine, SimdKernel
from ravenjax.engines.interface import Block
from ravenjax.outcomes import events
from ravenjax.stages.recorded import read_series

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)

pytestmark = [pytest.mark.slow, NEEDED]
SCRIPTS = Path(program.__file__).with_name("static")
THREADS = 2


@pytest.fixture(scope="module")
def config():
    return rj.load_campaign("quick")


@pytest.fixture(scope="module")
def ready(config):
    return program.question_plan(config)


@pytest.fixture(scope="module")
def description(config):
    return program.describe_program(config)


@pytest.fixture(scope="module")
def page(description, tmp_path_factory):
    """A page that holds the scripts in itself, with an engine open."""
    path = tmp_path_factory.mktemp("page") / "index.html"
    script = (
        f'import {{ openEngine }} from "{PREFIX}engine.js"; window.openEngine = openEngine;'
        " window.loaded = true"
    )
    modules = f'<script type="importmap">{import_map(SCRIPTS)}</script>'
    path.write_text(
        f'<!doctype html><meta charset="utf-8">{modules}<script type="module">{script}</script>'
    )
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        window = browser.new_page()
        urls, told = [], []
        window.on("request", lambda request: urls.append(request.url))
        window.on("pageerror", lambda error: told.append(str(error)))
        window.goto(path.as_uri())
        window.wait_for_function("window.loaded")
        window.evaluate(
            "async ([d, threads]) => { window.engine = await openEngine(d, { threads }) }",
            [description, THREADS],
        )
        yield window
        assert not told
        assert all(url.startswith(("file:", "data:", "blob:")) for url in urls)
        browser.close()


def faults_of(ready, slot=0):
    """The faults of a plan's runs in one slot as a page asks for them; None: a run without a
    fault.
    """
    words, numbers = (
        ("site", "arm", "channel", "effect", "trigger"),
        ("value", "start_ms", "duration_ms", "every_ms"),
    )
    words = {name: ready.rows[f"fault{slot}_{name}"].tolist() for name in words}
    numbers = {name: ready.rows[f"fault{slot}_{name}"].tolist() for name in numbers}
    keys = ready.faults["key"][:, slot].tolist()
    rows = []
    for run in range(ready.runs):
        row = {name: column[run] for name, column in (words | numbers).items()} | {"key": keys[run]}
        row["value"] = None if math.isnan(row["value"]) else row["value"]
        rows.append(row if row["site"] else None)
    return rows


ASK = """async ([changes, faults, name]) => {
  const outcomes = await window[name].outcomes({ ...window[name].question(), ...changes }, faults);
  const plain = (_, value) => (typeof value === "number" && !Number.isFinite(value) ? `${value}` : value);
  return outcomes.map((one) => JSON.stringify(one, plain));
}"""  # noqa: E501
INFINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


def answers(page, ready, changes, name="engine"):
    """Outcomes of every run of a plan, question by question."""
    questions = {}
    for run in range(ready.runs):
        questions.setdefault(
            tuple(column[run].item() for column in ready.varied.values()), []
        ).append(run)
    slots = [faults_of(ready, slot) for slot in range(ready.program.setup.injection.slots)]
    faults = [[fault for fault in run if fault] for run in zip(*slots, strict=True)]
    rows = [{}] * ready.runs
    for values, runs in questions.items():
        question = dict(zip(ready.varied, values, strict=True)) | changes
        texts = page.evaluate(ASK, [question, [faults[run] for run in runs], name])
        for run, text in zip(runs, texts, strict=True):
            rows[run] = json.loads(text)
    return rows


def unfused():
    """This machine's CPU, its fused multiply-add left alone: WebAssembly has none."""
    return dataclasses.replace(jit.host_target(), features=jit.host_target().features - {"fma"})


class Unfused(SimdEngine):
    def compile(self, program, runs):
        kernel = super().compile(program, runs)
        kernel._host = unfused()
        return kernel


def table(config, ready, engine):
    parts = list(Computation(ready, engine).blocks([range(ready.runs)]))
    own, golden = (
        {name: np.concatenate([part[k][name] for part in parts]) for name in parts[0][k]}
        for k in range(2)
    )
    return pd.DataFrame(outcomes.result_columns(config, ready.rows, own, golden))


OF_THE_TABLE = ("run_id", "index", "pair", "group", "seed", "operator")


def same_rows(rows, frame):
    for name in frame.columns:
        if name in OF_THE_TABLE or re.match(r"fault\d+_|param:", name):
            continue
        right = frame[name].tolist()
        text = any(isinstance(value, str) for value in right)
        got = [row[name] if text else INFINITE.get(row[name], row[name]) for row in rows]
        if text:
            assert got == right, name
        else:
            np.testing.assert_array_equal(
                np.array(got, float), np.array(right, float), err_msg=name
            )


@pytest.mark.parametrize("observe", [None, 100])
def test_quick_is_that_of_the_native_engines_word_by_word(page, observe):
    config = rj.load_campaign(
        "quick", [] if observe is None else [f"campaign.observe_ms={observe}"]
    )
    ready = program.question_plan(config)
    rows = answers(page, ready, {"observe_ms": observe})
    ours = table(config, ready, Unfused())
    assert len(rows) == len(ours) > 2500
    assert ours["verdict"].nunique() > 20
    same_rows(rows, ours)
    valid, evades = events.events_happened(pa.Table.from_pandas(ours), ["evades"], events.Rules())
    assert [row["evades"] for row in rows] == (valid & evades).tolist()
    assert 0 < evades.sum() < len(rows)


def test_two_arms_with_two_faults_that_repeat_are_those_of_the_native_engine(page):
    """Arms, slots, triggers, detectors and effects that quick.toml has none of."""
    first = {
        "site": "usb_out",
        "arm": ["gold", "green"],
        "channel": "elbow",
        "effect": ["random", "scale"],
        "value": [0.5, 9000.0],
        "start_ms": 100,
        "duration_ms": 20,
        "every_ms": [0, 70],
    }
    second = {
        "site": "network",
        "effect": "drop",
        "start_ms": 150,
        "duration_ms": 30,
        "trigger": "packet",
    }
    config = rj.load_campaign(
        {
            "campaign": {"name": "both", "duration_s": 0.4, "arms": ["gold", "green"]},
            "operator": {"motion": "reach"},
            "group": [
                {"name": "free"},
                {"name": "one", "fault": [first]},
                {"name": "two", "fault": [first, second]},
            ],
            "detector": [{"name": "steps", "kind": "steps", "threshold": [1.0, 2.0]}],
        }
    )
    ready = program.question_plan(config)
    page.evaluate(
        "async (d) => { window.other = await openEngine(d, { threads: 1 }) }",
        program.describe_program(config),
    )
    rows = answers(page, ready, {}, "other")
    page.evaluate("other.close()")
    ours = table(config, ready, Unfused())
    assert ours["activated"].sum() > 10 and ours["verdict"].nunique() > 1
    same_rows(rows, ours)


def test_a_replay_is_the_trace_of_the_run(page, config, ready, description):
    row = ready.rows["fault0_site"].tolist().index("usb_out")
    kernel = SimdKernel(traced.printable_program(ready.program), 1, signals=True, host=unfused())
    (varied, faults), (_, harmless) = (
        ready.lanes([row], 1, harmless=free) for free in (False, True)
    )
    golden = kernel.run(Block(varied, harmless, None), ready.columns)
    _, signals = kernel.run_signals(Block(varied, faults, golden.reference), ready.columns)
    series = read_series(config.robot, ready.program, signals, golden.reference[:, :, 0])
    told = page.evaluate(
        """async (fault) => {
          const { faulty, golden, period_ms, outcome } = await engine.replay(engine.question(), fault);
          const plain = Object.fromEntries(Object.entries(faulty).map(([name, values]) => [name, [...values]]));
          const text = JSON.stringify(plain, (_, v) => (typeof v === "number" && !Number.isFinite(v) ? `${v}` : v));
          return [text, [...golden["gold/tip"]], period_ms, outcome.unintended_mm];
        }""",  # noqa: E501
        faults_of(ready)[row],
    )
    faulty, golden_tip, period = json.loads(told[0]), told[1], told[2]
    assert period == 1
    names = [output["name"] for output in description["programs"]["replay"]["outputs"]]
    assert {
        "gold/jpos",
        "gold/link_jpos",
        "gold/tip",
        "gold/dac_cnt",
        "gold/cue_force",
        "fault0_active",
    } <= {*names}
    for name in names:
        right = np.asarray(series[name], np.float64).ravel()
        np.testing.assert_allclose(
            np.float64(faulty[name]), right, rtol=1.2e-7, atol=0, err_msg=name
        )
    np.testing.assert_array_equal(
        np.float32(golden_tip), np.float32(series["gold/golden_tip"]).ravel()
    )
    apart = np.linalg.norm(np.float64(series["gold/tip"]) - series["gold/golden_tip"], axis=1) * 1e3
    np.testing.assert_allclose(faulty["gold/deviation_mm"], apart, rtol=1e-6, atol=1e-6)
    assert max(apart) > 0.1
    assert faulty["unintended_mm"][-1] == max(faulty["unintended_mm"]) == told[3] > 0


def test_what_is_cancelled_is_given_up_and_the_rest_goes_on(page, ready):
    many = [fault for fault in faults_of(ready) if fault][:200]
    told = page.evaluate(
        """async (faults) => {
          const question = engine.question();
          const first = engine.outcomes(question, faults, { token: "old" }).then(() => "done", (error) => error.name);
          const second = engine.outcomes(question, faults.slice(0, 3), { priority: 5, token: "new" });
          engine.cancel("old");
          return [await first, (await second).length, (await engine.golden(question)).verdict];
        }""",  # noqa: E501
        many,
    )
    assert told == ["AbortError", 3, "silent/none/no cue"]


@pytest.mark.parametrize("tick_ms", [1, 4])
def test_deadlines_are_those_of_the_command(page, tick_ms, tmp_path):
    fault = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow"],
        "effect": "overwrite",
        "value": [9000, 20000],
        "start_ms": 700,
        "duration_ms": 64,
    }
    campaign = {"name": "act", "duration_s": 1.2}
    if tick_ms > 1:
        model = resources.find_model("ur5e/ur5e.xml").read_text()
        (tmp_path / "arm.xml").write_text(model.replace('"0.001"', f'"{tick_ms / 1e3}"'))
        campaign |= {"robot": str(tmp_path / "arm.xml"), "observe_ms": 400}
        fault |= {"site": "torque", "channel": "elbow", "effect": "drift", "value": [-150, -10]}
    config = rj.load_campaign(
        {"campaign": campaign, "group": [{"name": "harmful", "fault": [fault]}]},
        # A slow arm, which soon stands still.
        ["operator.amplitude=0.005"] * (tick_ms > 1),
    )
    ready, actor = program.question_plan(config), Actor(config, "simd")
    page.evaluate(
        "async (d) => { window.other = await openEngine(d, { threads: 1 }) }",
        program.describe_program(config),
    )
    same_rows(answers(page, ready, {}, "other"), table(config, ready, Unfused()))
    told = page.evaluate(
        """async (faults) => {
          const question = other.question();
          const outcomes = await other.outcomes(question, faults);
          const found = [];
          for (const [k, one] of outcomes.entries())
            if (one.unintended_first_ms >= 0)
              found.push([k, one.first_active_ms, one.unintended_first_ms, await other.deadlines(question, faults[k], one)]);
          other.close();
          return found;
        }""",  # noqa: E501
        faults_of(ready),
    )
    assert len(told) >= 2
    row, *times = (np.repeat([one[k] for one in told], len(actor.actions)) for k in range(3))
    effect, harm = (ms // tick_ms for ms in times)
    lanes = FaultActions(row, np.tile(list(actor.actions.values()), len(told)), effect, harm)
    found = actor.find(lanes, lambda text: None)[0]
    ours = np.where(found < effect, -1, found * tick_ms).reshape(len(told), -1)
    assert (ours > 0).any() and (ours < 0).any()
    assert [list(one[3].values()) for one in told] == ours.tolist()

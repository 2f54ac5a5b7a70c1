"""The facts of a run by SQL against plain pandas, for any table and rules."""

import naive_facts
import numpy as np
import pytest
import reacting_results as reacting
import synthetic_results as synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.outcomes.events import Rules
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.facts import Choices
from ravenjax.store.access import query


def facts_of(frame, cue=0, jump="jump_code", action=0):
    with query.open_empty() as table:
        run_facts.register_table(table, frame)
        run_facts.define_facts(table, Choices(Rules(cue=cue, jump=jump), action))
        return table.frame("SELECT * EXCLUDE row FROM facts ORDER BY row")


def same(frame, cue=0, jump="jump_code", action=0):
    told = facts_of(frame, cue, jump, action)
    naive = naive_facts.derive(frame, cue, jump, action)
    assert {*told, "run_id"} == set(naive)
    for name in told:
        if name == "distinct":  # any number will do that is equal where it must be
            assert (
                len(set(zip(told[name], naive[name], strict=True)))
                == told[name].nunique()
                == naive[name].nunique()
            )
        else:
            one, other = told[name].to_numpy(), naive[name].to_numpy()
            assert ((one == other) | ((one != one) & (other != other))).all(), name


def mixed(frame, seed, cue=0):
    """Inputs that repeat, failed runs, golden runs with cues and halts, reactions that are not
    said, negative zeros.
    """
    random = np.random.default_rng(seed)
    rows = len(frame)
    given_columns = [c for c in frame if c.startswith(("fault", "param:plant")) or c == "operator"]
    copied = random.random(rows) < 0.5
    frame = frame.copy()
    origin = random.integers(0, max(1, rows // 3), copied.sum())
    for name in given_columns:
        values = np.array(frame[name])
        values[copied] = values[origin]
        frame[name] = values
    frame["pair"] = np.where(
        random.random(rows) < 0.5, random.integers(0, rows, rows), frame["pair"]
    )
    frame["failed"] = np.where(random.random(rows) < 0.2, "nan", "")
    for name in ("cue0_first_ms", "cue2_first_ms"):
        frame[f"golden_{name}"] = np.where(
            random.random(rows) < 0.4, frame[name] + random.integers(-3, 4, rows), -1
        )
    frame["halted_ms"] = random.choice([0, 4, 203, 204, 205, 900], rows)
    frame["golden_halted_ms"] = random.choice([0, 4, 5, 700], rows)
    for name in ("unintended_first_ms", "loss_first_ms", "false_report_first_ms"):
        frame[name] = np.where(random.random(rows) < 0.5, -1, random.integers(0, 900, rows))
    frame.loc[random.random(rows) < 0.3, "param:plant.friction_scale"] = np.nan
    frame["fault0_value"] = np.where(
        random.random(rows) < 0.2, random.choice([0.0, -0.0], rows), frame["fault0_value"]
    )
    if run_facts.ACTION in frame:
        frame.loc[random.random(rows) < 0.3, run_facts.ACTION] = np.nan
    return synthetic.judged(frame, cue)


RULES = [(0, "jump_code", 0), (2, "jump_text", 1), (6, "jump_tip", 3)]


@pytest.mark.slow
@settings(max_examples=15)
@given(st.integers(1, 60), st.integers(0, 10**6), st.booleans(), st.sampled_from(RULES))
def test_any_table_gives_the_same_facts(rows, seed, reacts, rules):
    frame = mixed(
        reacting.frame(rows, seed) if reacts else synthetic.frame(rows, seed), seed, rules[0]
    )
    same(frame.sample(frac=1, random_state=seed), *rules)


def test_the_order_of_two_faults_matters_only_on_the_same_channel():
    frame = synthetic.frame(4).assign(pair=range(4), operator="suture", failed="")
    frame["param:plant.friction_scale"] = 1.0
    fault = {name: frame[name].iloc[0] for name in frame if name.startswith("fault0_")}
    for name, value in fault.items():
        frame[name] = frame[name.replace("fault0", "fault1")] = value
    frame["fault0_value"], frame["fault1_value"] = [1.0, 2.0, 1.0, 2.0], [2.0, 1.0, 2.0, 1.0]
    frame["fault0_channel"] = ["shoulder", "elbow", "shoulder", "shoulder"]
    frame["fault1_channel"] = ["elbow", "shoulder", "shoulder", "shoulder"]
    distinct = facts_of(frame)["distinct"].to_numpy()
    assert distinct[0] == distinct[1] and len(set(distinct)) == 3


def test_words_may_be_categories_and_slots_may_be_none():
    frame = synthetic.frame(100)
    words = ("group", "response", "hazard", "verdict", "failed", "fault0_site", "operator")
    same(frame.astype(dict.fromkeys(words, "category")))
    same(frame.drop(columns=[name for name in frame if name.startswith(("fault0", "applied0"))]))

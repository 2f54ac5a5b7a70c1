"""Parts of one's own: what a file may say, and one clear error for each way of saying it wrong."""

import dataclasses
import pickle
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.engines.traced import refuse_leaked_numbers
from ravenjax.errors import UserError
from ravenjax.parts import part
from ravenjax.parts.part import SCORE

HEAD = "from ravenjax.parts import Annotated, Quantity, Scalar, Vec, jnp, load, record, where\n"
COUNTER = """
@record
class Limit:
    most: Annotated[Scalar, Quantity("counts", 1, 100, "score of 1")]

@record
class Count:
    seen: Scalar
    last: Vec

def params():
    return Limit(10.0)

def init(params):
    return Count(0, Vec.full(2, 0.0))

def step(params, state, view):
    return Count(state.seen + 1, Vec((view, state.last[0]))), state.seen / params.most
"""


def written(folder: Path, text: str, head: str = HEAD) -> Path:
    path = folder / "mine.py"
    path.write_text(head + textwrap.dedent(text))
    return path


def traced(path: Path) -> tuple:
    """State and score after two milliseconds, traced by JAX."""
    own = part.load_part(part.read_source("mine", path))
    params = own.params()

    def two(view):
        state = own.init(params, "float32")
        state, _ = own.step(params, state, view, "float32", score=SCORE)
        return own.step(params, state, view, "float32", score=SCORE)

    return jax.jit(two)(jnp.float32(3.0))


def test_a_part_counts_and_remembers(tmp_path):
    state, score = traced(written(tmp_path, COUNTER))
    assert (int(state.seen), state.last, float(score)) == (2, (3.0, 3.0), np.float32(0.1))
    assert state.seen.dtype == np.int32 and score.dtype == np.float32


def test_its_parameters_have_ranges(tmp_path):
    source = part.read_source("mine", written(tmp_path, COUNTER))
    ((path, limits),) = part.part_quantities(source)
    assert (path, limits.low, limits.high, limits.unit) == ("most", 1, 100, "counts")


STEP = "\ndef step(params, state, view):\n    "
WRONG = {
    "no step": ("x = 1", r"expected a function step\(params, state, view\)"),
    "one thing": (
        STEP + "return view",
        r"step\(params, state, view\) returns .* expected \(state, score\)",
    ),
    "branch": (
        STEP + "if view > 1:\n        return state, 1.0\n    return state, 0.0",
        r"mine\.py:4: .* jnp\.where",
    ),
    "kind": (
        "def init(params):\n    return (0,)\n" + STEP + "return (state[0] + view,), view",
        r"returns a float for state\[0\], expected int",
    ),
    "no range": (
        "@record\nclass P:\n    a: Scalar\n\ndef params():\n    return P(1.0)\n"
        + STEP
        + "return state, view",
        r"has a without a range: annotate it with Quantity",
    ),
    "out of range": (
        COUNTER.replace("Limit(10.0)", "Limit(0.5)"),
        r"returns 0\.5 for most, expected 1\.\.100 counts",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_by_one_error_with_its_place(tmp_path, case):
    text, said = WRONG[case]
    with pytest.raises(UserError, match=said) as error:
        traced(written(tmp_path, text))
    assert str(tmp_path / "mine.py") in str(error.value) or case == "weights"


def test_arrays_beside_the_file_count_as_its_content(tmp_path):
    path = written(
        tmp_path, "weights = load('w.npz')['a']\n" + STEP + "return state, view * float(weights[1])"
    )
    digests = []
    for factor in (2.0, 3.0):
        np.savez(tmp_path / "w.npz", a=np.array([0.0, factor]))
        digests.append(part.hash_source(part.read_source("mine", path)))
    assert digests[0] != digests[1]
    assert traced(path)[1] == 9.0


def test_modules_beside_the_file_count_as_its_content(tmp_path):
    path = written(
        tmp_path,
        "import gains\nfrom limits import MOST\n" + STEP + "return state, gains.of(view) * MOST",
    )
    (tmp_path / "limits.py").write_text("MOST = 2.0\n")
    digests = []
    for factor in (3.0, 5.0):
        (tmp_path / "gains.py").write_text(
            f"import limits\n\ndef of(x):\n    return {factor} * x / limits.MOST\n"
        )
        digests.append(part.hash_source(part.read_source("mine", path)))
    source = part.read_source("mine", path)
    assert digests[0] != digests[1] == part.hash_source(source) and traced(path)[1] == 15.0
    assert [name for name, _ in source.files] == ["gains.py", "limits.py"]
    assert "gains" not in sys.modules
    (tmp_path / "limits.py").write_text("MOST = 4.0\n")
    assert not part.is_unchanged(source)


def test_two_parts_may_import_modules_of_one_name(tmp_path):
    scores = []
    for place, factor in (("a", 2.0), ("b", 7.0)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "gains.py").write_text(f"GAIN = {factor}\n")
        text = "import gains\n" + STEP + "return state, view * gains.GAIN"
        scores.append(traced(written(tmp_path / place, text))[1])
    assert scores == [6.0, 21.0]


KEPT = """
kept = []

def init(params):
    kept.append(jnp.float32(2.5) * jnp.float32(3.0))
    return (jnp.float32(0.0), kept[0])

def step(params, state, view):
    return state, {score}
"""


@pytest.mark.parametrize("score", ["view * kept[0]", "kept[0]", "state[0] + kept[0]"])
def test_numbers_kept_between_calls_are_refused(tmp_path, score):
    own = part.load_part(part.read_source("mine", written(tmp_path, KEPT.format(score=score))))

    def trace():
        jax.make_jaxpr(lambda: own.init(None, "float32"))()
        jax.jit(lambda view: own.step(None, (0.0, 1.0), view, "float32", score=SCORE))(
            jnp.float32(3.0)
        )

    where = r"mine\.py:6: the code uses a jnp number of an earlier call"
    with pytest.raises(UserError, match=where), refuse_leaked_numbers():
        trace()


def test_parameters_travel_to_a_process_that_has_no_files(tmp_path):
    counter = COUNTER.replace("state.seen /", "weights[1] * one.ONE * state.seen /")
    path = written(tmp_path, "import one\nweights = load('w.npy')\n" + counter)
    (tmp_path / "one.py").write_text("ONE = 1\n")
    np.save(tmp_path / "w.npy", np.array([1.0, 7.0]))
    sources = (part.read_source("mine", path),)
    own = part.part_parameters(sources)
    varied = own._replace(mine=dataclasses.replace(own.mine, most=20.0))
    message = pickle.dumps((sources, varied))
    shutil.rmtree(tmp_path)
    code = (
        "import pickle, sys; from ravenjax.parts import part; sources, own ="
        " pickle.load(sys.stdin.buffer); mine = part.load_part(sources[0]);"
        " memory = mine.init(own.mine, 'float32');"
        " score = mine.step(own.mine, memory, 0.0, 'float32', score=part.SCORE)[1];"
        " print(own.mine.most, score * 0, own._fields)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], input=message, capture_output=True, check=True
    )
    assert done.stdout.decode().split() == ["20.0", "0.0", "('mine',)"]


def test_what_a_part_prints_is_no_output(tmp_path, capsys):
    text = "print('read')" + STEP + "print('traced')\n    return state, view"
    traced(written(tmp_path, text))
    output, aside = capsys.readouterr()
    assert output == "" and aside.startswith("read") and "traced" in aside

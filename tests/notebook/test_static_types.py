"""The static types of campaigns in Python: up to date, complete, and as good as an editor needs
them.
"""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import ravenjax as rj
from ravenjax.campaign.file.axis import DISTRIBUTIONS, PHASE
from ravenjax.notebook import axes, static_types, tables
from ravenjax.notebook.table_classes import CLASSES, CampaignTable

STUB = Path(tables.__file__).with_suffix(".pyi")
RIGHT = """
import numpy as np
import ravenjax as rj

fault = rj.Fault(site="usb_out", channel=["elbow"], effect="offset", value=rj.uniform(-5, 5), start_ms=[1, 2])
other = rj.Fault(site="tau_d", effect=rj.choice(["scale"]), value=np.linspace(0, 1), start_ms=rj.phase("fast", 0.5))
group = rj.Group(name="a", design="random", runs=3, fault=[fault, other], parameters={"plant.mass_scale": [1, 2]})
campaign = rj.Campaign(name="x", arms=["gold"], group=[group, rj.Group(name="b", hazards=["C02"])], duration_s=1)
rows: int = len(campaign.run(engine="simd").rates(by="site"))
text: str = campaign.replace(seed=3).to_toml()
"""  # noqa: E501
WRONG = {
    'rj.Fault(site="usb_ou", effect="offset", start_ms=1)': "usb_ou",
    'rj.Fault(site="usb_out", efect="offset", start_ms=1)': "efect",
    'rj.Fault(site="usb_out", effect="offset")': "start_ms",
    'rj.Group(name="a", runs=1.5)': "float",
    'rj.Campaign(name="x", group=[rj.Fault(site="hand", effect="drop", start_ms=1)])': "Group",
    'rj.Campaign(name="x", group=[], level="expert")': "expert",
    "rj.Haptics(cap='much')": "cap",
}


def test_the_stub_is_up_to_date():
    assert STUB.read_text(encoding="utf-8") == static_types.text(), f"run `{static_types.COMMAND}`"


def test_every_table_is_public_with_every_key_of_its_model():
    classes = {
        node.name: node
        for node in ast.parse(STUB.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    }
    assert set(classes) == {*CLASSES, CampaignTable.__name__}
    for name, kind in CLASSES.items():
        assert getattr(rj, name) is kind and name in rj.__all__
        init = next(
            node
            for node in classes[name].body
            if isinstance(node, ast.FunctionDef) and node.name == "__init__"
        )
        assert {one.arg for one in init.args.kwonlyargs} == set(kind._names)
        assert all(kind._names.values()), "a key without a meaning"


def test_every_form_of_an_axis_has_a_function():
    functions = {
        name
        for name, one in vars(axes).items()
        if callable(one) and one.__module__ == axes.__name__
    }
    assert functions == {*DISTRIBUTIONS, PHASE} and functions < set(rj.__all__)
    assert rj.uniform(1, 2) == {"uniform": [1, 2]} and rj.together((1, 2)) == {"together": [1, 2]}
    assert rj.normal(1, 0.1) == {"normal": [1, 0.1]} and rj.loguniform(1, 9) == {
        "loguniform": [1, 9]
    }
    assert rj.phase("fast", (0, 1)) == {"phase": "fast", "share": [0, 1]}


@pytest.mark.slow
def test_a_checker_takes_what_is_right_and_marks_what_is_not(tmp_path):
    (tmp_path / "right.py").write_text(RIGHT)
    for place, line in enumerate(WRONG):
        (tmp_path / f"wrong{place}.py").write_text(f"import ravenjax as rj\n\n{line}\n")
    command = [
        sys.executable,
        "-m",
        "pyright",
        "--outputjson",
        "--pythonpath",
        sys.executable,
        str(tmp_path),
    ]
    root = Path(rj.__file__).parents[1]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=root)
    marked = {}
    for one in json.loads(done.stdout)["generalDiagnostics"]:
        marked.setdefault(Path(one["file"]).name, []).append(one["message"])
    assert "right.py" not in marked, marked
    for place, (line, word) in enumerate(WRONG.items()):
        assert any(word in message for message in marked.get(f"wrong{place}.py", [])), line

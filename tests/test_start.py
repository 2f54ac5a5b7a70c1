"""What each command imports: heavy libraries where they are used; a campaign needs no JAX."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
HEAVY = (
    "duckdb",
    "fastapi",
    "jax",
    "jaxlib",
    "jinja2",
    "llvmlite",
    "matplotlib",
    "mcap",
    "mujoco",
    "pandas",
    "pyarrow",
    "pydantic",
    "scipy",
    "statsmodels",
    "xarray",
)
PROBE = """
import json, sys
from ravenjax.cli import main
code = main(sys.argv[2:]) if len(sys.argv) > 2 else __import__("ravenjax") and 0
devices = "jax" in sys.modules and __import__("jax._src.xla_bridge", fromlist=["x"]).backends_are_initialized()
record = {"code": code, "modules": sorted(set(sys.argv[1].split(",")) & set(sys.modules)), "devices": devices}
sys.stderr.write("\\n" + json.dumps(record))
"""  # noqa: E501
CAMPAIGN = """
[campaign]
name = "start"
duration_s = 0.05
[operator]
motion = "reach"
[[group]]
name = "dac"
design = "{design}"
runs = 4
[[group.fault]]
site = "usb_out"
channel = "elbow"
effect = "offset"
value = {{ uniform = [0, {most}] }}
start_ms = {{ uniform = [5, 20] }}
[group.parameters]
plant.mass_scale = {{ uniform = [0.9, {heaviest}] }}
"""


def probed(*tokens: str, cache: Path | str = "off") -> dict:
    """What a command imports in a process of its own, and whether JAX looked for devices."""
    command = [sys.executable, "-c", PROBE, ",".join(HEAVY), *tokens]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env=os.environ | {"RAVENJAX_CACHE": str(cache)},
    )
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stderr.splitlines()[-1])
    assert record["code"] == 0, done.stderr
    return record


def test_the_package_and_its_help_import_nothing_heavy():
    assert probed()["modules"] == []
    assert probed("--help")["modules"] == []
    assert probed("run", "--help")["modules"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "tokens", [("campaigns",), ("check", "campaigns/quick.toml"), ("faults",), ("parameters",)]
)
def test_a_look_at_campaigns_needs_no_tick(tokens):
    assert not {"jax", "mujoco", "duckdb"} & set(probed(*tokens)["modules"])


def run_probed(file: Path, out: Path) -> dict:
    words = f"run {file} --no-report --engine simd --out {out}"
    return probed(*words.split(), cache=file.parent / "cache")


@pytest.mark.slow
@pytest.mark.parametrize("design", ["lhs", "sobol", "random"])
def test_a_campaign_whose_trace_is_kept_imports_no_jax(tmp_path, design):
    def run(name: str, **values: float) -> dict:
        file = tmp_path / f"{name}.toml"
        file.write_text(CAMPAIGN.format(design=design, **values))
        return run_probed(file, tmp_path / name)

    run("cold", most=4000, heaviest=1.1)
    warm = run("warm", most=9000, heaviest=1.2)
    heavy = {"jax", "jaxlib", "mujoco"} | ({"scipy"} if design != "sobol" else set())
    assert not heavy & set(warm["modules"])


@pytest.mark.slow
def test_a_detector_whose_trace_is_kept_needs_no_jax(tmp_path):
    (tmp_path / "mine.py").write_text(
        "def step(params, state, view):\n    return state, view.tip_error * 1e3\n"
    )
    file = tmp_path / "own.toml"
    own = '[[detector]]\nname = "mine"\nfile = "mine.py"\n'
    file.write_text(CAMPAIGN.format(design="random", most=4000, heaviest=1.1) + own)
    for name in ("cold", "warm"):
        modules = run_probed(file, tmp_path / name)["modules"]
    assert not {"jax", "jaxlib"} & set(modules)

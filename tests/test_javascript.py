"""The package's scripts: node runs their unit tests, a linter reads them. Each needs a program
that may be absent.
"""

import re
import shutil
import subprocess
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TESTS = sorted(path.relative_to(ROOT) for path in (ROOT / "tests").rglob("*.test.mjs"))
NODE = shutil.which("node")
OXLINT = shutil.which("oxlint", path=sysconfig.get_path("scripts")) or shutil.which("oxlint")


def finished(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command], cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
@pytest.mark.skipif(NODE is None, reason="no node on the path (apt-get install nodejs)")
@pytest.mark.parametrize("file", TESTS, ids=lambda path: path.name)
def test_unit_tests_of_scripts_pass(file):
    told = finished(NODE, "--test", file)
    assert told.returncode == 0, told.stdout + told.stderr
    passed = re.search(r"^\S pass (\d+)$", told.stdout, re.MULTILINE)
    assert passed and int(passed[1]) > 2, told.stdout


@pytest.mark.skipif(OXLINT is None, reason="oxlint is not installed (pip install oxlint)")
def test_a_linter_has_nothing_to_say():
    told = finished(OXLINT, "--deny-warnings", "ravenjax", "tests")
    assert told.returncode == 0, told.stdout + told.stderr
    read = re.search(r"on (\d+) files", told.stdout)
    assert read and int(read[1]) > 15, told.stdout

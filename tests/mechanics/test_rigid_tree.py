"""The constants of an arm's dynamics are the same on every CPU."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

PRINT_LINKS = """
import mujoco
from ravenjax.mechanics.rigid_tree import read_tree
model = mujoco.MjModel.from_xml_path("models/raven2/raven2.xml")
for link in read_tree(model, model.body(1).name):
    print(link.beta, link.alpha, link.offset, link.position, link.pseudo_inertia.tolist())
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="kernels of BLAS for x86-64")
def test_constants_do_not_depend_on_the_kernels_that_blas_selects_for_a_cpu():
    printed = {
        subprocess.check_output(
            [sys.executable, "-c", PRINT_LINKS],
            cwd=Path(__file__).parents[2],
            env=os.environ | {"OPENBLAS_CORETYPE": core},
        )
        for core in ("Prescott", "Haswell")
    }
    assert len(printed) == 1

"""C structs of records: their members lie where compiled code looks for them, said by a C
compiler.
"""

import re
import shutil
import subprocess

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.robots.raven2.c_library import make_library, struct_members


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_members_lie_where_code_finds_them(tmp_path):
    software, robot = rj.ControlSoftware(arms=["gold"]), rj.VirtualRobot(arms=["gold"])
    (tmp_path / "robot.h").write_text(make_library(software, robot).header)
    asks, expected = "", []
    for part, kinds in (("control", software.code.kinds), ("robot", robot.code.kinds)):
        for what in ("params", "state", "signals"):
            first = 0
            for member in struct_members(kinds[what], ["gold"], {}):
                struct = f"raven_{part}_{what}"
                asks += f'  printf("%zu\\n", offsetof({struct}, {member.name}));\n'
                expected.append(kinds[what].layout.offsets[first])
                first += int(np.prod([*map(int, re.findall(r"\d+", member.dimensions))]))
            assert first == len(kinds[what].layout.types)
    (tmp_path / "places.c").write_text(
        '#include <stddef.h>\n#include <stdio.h>\n#include "robot.h"\n'
        f"int main(void) {{\n{asks}  return 0;\n}}\n"
    )
    program = tmp_path / "places"
    subprocess.run(["cc", "-std=c11", "-o", program, tmp_path / "places.c"], check=True)
    places = subprocess.run([program], check=True, capture_output=True, text=True).stdout.split()
    assert [*map(int, places)] == expected and len(places) > 150

"""C structs of records: their members lie where compiled code looks for them, said by a C
compiler.
"""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.engines.cpu.transition import RecordKind
from ravenjax.numbers.vec import Vec, record
from ravenjax.robots.raven2.c_library.library import members, struct

ARMS = ("gold", "green")
NUMBERS = st.sampled_from([np.float32(1), np.float64(1), np.int32(1), np.uint32(1), np.bool_(True)])
VECS = st.tuples(NUMBERS, st.integers(1, 5)).map(lambda pair: Vec((pair[0],) * pair[1]))
FIELDS = NUMBERS | VECS | VECS.map(lambda vec: (vec, vec)) | st.none()


@record
class Inner:
    narrow: object
    wide: object


@record
class Outer:
    first: object
    arms: object
    last: object


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@settings(max_examples=15, deadline=None)
@given(first=FIELDS, narrow=FIELDS, wide=FIELDS, last=NUMBERS)
def test_members_lie_where_code_finds_them(tmp_path_factory, first, narrow, wide, last):
    kind = RecordKind.of(Outer(first, (Inner(narrow, wide),) * 2, last))
    own = members(kind, ARMS)
    names = [member.name for member in own]
    assert len(names) == len(set(names))
    counts = [int(np.prod(member.dimensions)) for member in own]
    starts = np.cumsum([0, *counts])[:-1]
    folder = tmp_path_factory.mktemp("struct")
    source = folder / "places.c"
    asks = "\n".join(f'  printf("%zu\\n", offsetof(thing, {name}));' for name in names)
    source.write_text(
        "#include <stddef.h>\n#include <stdint.h>\n#include <stdio.h>\n"
        "#define RAVEN_ASSERT(truth, name) _Static_assert(truth, #name)\n"
        + struct("thing", own, kind.layout.bytes, "a thing")
        + f"int main(void) {{\n{asks}\n  return 0;\n}}\n"
    )
    program = folder / "places"
    subprocess.run(["cc", "-std=c11", "-o", program, source], check=True)
    places = subprocess.run([program], check=True, capture_output=True, text=True).stdout.split()
    assert [int(place) for place in places] == [kind.layout.offsets[start] for start in starts]

"""Printed CUDA C means what the straight-line program means: compiled as C++ here, operation by
operation.
"""

from __future__ import annotations

import numpy as np
import pytest
from cuda_as_cpp import Library
from cuda_cases import CASES, SOURCE, check

from ravenjax.engines.gpu.cuda import constant, expression


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return Library(SOURCE, tmp_path_factory.mktemp("cuda"))


@pytest.mark.parametrize("k", range(len(CASES)), ids=[name for name, _, _ in CASES])
def test_every_operation_gives_the_bits_that_it_means(library, k):
    def launch(name, given, out, n):
        library.launch(name, n, 1, given, out, n)
        return out

    check(launch, k)


def test_constants_keep_their_bits():
    assert constant("float32", np.float32(-0.0)) == "(-0.f)"
    assert constant("float32", np.float32(np.inf)) == "__uint_as_float(0x7f800000u)"
    assert constant("int32", np.int32(-(2**31))) == "(int)0x80000000u"
    assert constant("uint32", np.uint32(2**32 - 1)) == "4294967295u"


def test_an_operation_without_a_form_is_refused_by_name():
    with pytest.raises(NotImplementedError, match="'frobnicate' of float32"):
        expression("frobnicate", "float32", ["float32"], ["x"])
    with pytest.raises(NotImplementedError, match="'mul' of float64"):
        expression("mul", "float64", ["float64", "float64"], ["x", "y"])

"""Printed CUDA C means what the straight-line program means: compiled as C++ here, operation by
operation.
"""

import pytest
from cuda_as_cpp import Library
from cuda_cases import CASES, SOURCE, check


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return Library(SOURCE, tmp_path_factory.mktemp("cuda"))


@pytest.mark.parametrize("k", range(len(CASES)), ids=[name for name, _, _ in CASES])
def test_every_operation_gives_the_bits_that_it_means(library, k):
    def launch(name, given, out, n):
        library.launch(name, n, 1, given, out, n)
        return out

    check(launch, k)

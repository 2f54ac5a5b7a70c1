"""Choices between bits of several numbers, through vector code: of some, LLVM 22.1 makes one
instruction for AVX-512 that takes the wrong bits (`LlvmPrinter._select_as_floats`)."""

import random

import numpy as np
import pytest
from compiled_program import compiled

from ravenjax.ir import semantics
from ravenjax.ir.builder import Builder

LANES = 256
MASKS = (16, 255, -256, 3)


def columns():
    rng = np.random.default_rng(0)
    numbers = [rng.integers(-(2**31), 2**31, LANES).astype(np.int32) for _ in range(4)]
    return (*numbers, *(rng.integers(0, 2, LANES).astype(bool) for _ in range(3)))


def program(seed):
    """Two numbers made of others by logic and choices."""
    rng, builder = random.Random(seed), Builder()
    numbers = [builder.input("int32") for _ in range(4)]
    truths = [builder.input("bool") for _ in range(3)]

    def mixed(depth):
        """Some bits of one number, the others of another; or that, or one of the two."""
        x, y, mask = number(depth - 1), number(depth - 1), rng.choice(MASKS)
        masks = [builder.constant("int32", m) for m in (mask, ~mask)]
        sides = (builder.emit("and", "int32", z, m) for z, m in zip((x, y), masks, strict=True))
        mix = builder.emit("or", "int32", *sides)
        some = rng.choice(truths), *rng.sample([mix, rng.choice([x, y])], 2)
        return builder.emit("select", "int32", *some)

    def number(depth):
        if depth == 0 or rng.random() < 0.15:
            known = builder.constant("int32", rng.choice([16, -17, 1]))
            return rng.choice(numbers) if rng.random() < 0.7 else known
        kind = rng.choice(["mixed", "and", "or", "xor", "select"])
        if kind == "mixed":
            return mixed(depth)
        sides = number(depth - 1), number(depth - 1)
        condition = [rng.choice(truths)] if kind == "select" else []
        return builder.emit(kind, "int32", *condition, *sides)

    return builder.program([number(4), mixed(3)])


@pytest.mark.parametrize("width", [2, 4, 8, 16])
def test_bits_are_chosen_as_the_program_says(width):
    inputs = columns()
    for seed in range(25):
        one = program(seed)
        both = compiled(one, width, inputs), semantics.run_program(one, inputs)
        for number, value in zip(*both, strict=True):
            expected = np.broadcast_to(value, LANES)
            np.testing.assert_array_equal(number, expected, err_msg=f"seed {seed}")

"""Names for users' files: `from ravenjax.parts import Quantity, Scalar, Vec, jnp, record`.

A user's file is a Python file that a campaign names. It has functions in the style of the built-in stages:

    params()                    a record of numbers that a campaign may vary, each with a Quantity; may be left out
    init(params)                a record of what is remembered, before the first millisecond; may be left out
    step(params, state, view)   one millisecond of one arm: (state, score)

Without `params` or `init` the function gets None in their place, and gives None back for the state.
Every number is a single one: loops over joints are Python loops, choices are `jnp.where`, no Python
`if` looks at a value. What comes in `view` is the robot's own: of a Raven-II
`ravenjax.robots.raven2.loop.user_files.View`.

The file, the modules in its folder that it imports and the arrays there that it loads are its
content: another content is another campaign.
"""  # noqa: E501

from __future__ import annotations

from typing import Annotated

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, to_int32, where
from ravenjax.parts.reading import load

__all__ = [
    "Annotated",
    "Quantity",
    "Scalar",
    "Vec",
    "as_int",
    "jnp",
    "load",
    "record",
    "to_int32",
    "where",
]

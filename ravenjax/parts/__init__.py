"""Names for a user's check or detector: `from ravenjax.parts import Scalar, Vec, jnp, record`.

A user's file is a Python file that a campaign names. It has these functions:

    params()                    return a record of numbers that a campaign may vary, each with a
                                Quantity; optional
    init(params)                return the state before the first millisecond, a record; optional
    step(params, state, view)   compute one millisecond of one arm; return (state, score), or
                                (state, score, values) if a check limits a signal to `values`

Without `params` or `init`, `step` gets None in their place, and returns None as the state. Numbers
in records and views are scalars, never arrays. Write loops over joints as Python loops, and choices
as `jnp.where`. No Python `if` may depend on a value. `view` is a `parts.part.View`, whose signals
depend on the robot. The signals of a Raven-II are in the module `loop.user_files` of its package.

The content of a user's file includes the modules in its folder that it imports, and the arrays in
its folder that it loads. If this content changes, the campaign is a different campaign.
"""

from typing import Annotated

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, to_int32, where
from ravenjax.parts.reading import load

__all__ = ["Annotated", "Quantity", "Scalar", "Vec"]
__all__ += ["as_int", "jnp", "load", "record", "to_int32", "where"]

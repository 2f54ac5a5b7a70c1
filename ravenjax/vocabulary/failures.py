"""Lists the reasons why a run has no valid outcome: which number first became infinite or NaN.

A run is *failed* from the tick on in which a number of the virtual robot or of its observers is
infinite or NaN. Numbers of the control software may be infinite or NaN without failing the run: the
software continues with them, as the original software does. In robot or observers they fail it.
"""

from ravenjax import resources

SIGNALS: dict[str, str] = resources.read_tables(__file__, "failures.toml")
"""The signals that are checked for infinite numbers and NaN, in order, with descriptions."""

CODES: dict[str, int] = {name: i for i, name in enumerate(SIGNALS)}

CAUSES: tuple[str, ...] = ("", *(f"{name} not finite" for name in SIGNALS))
"""Words of the column `failed`; "" means a valid outcome."""

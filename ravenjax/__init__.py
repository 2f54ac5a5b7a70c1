"""A virtual Raven-II surgical robot with its control software, faults and haptics; thousands of
runs in parallel.

    import ravenjax as rj

    campaign = rj.Campaign.from_toml("quick")    # or rj.Campaign(name=.., group=[rj.Group(..)])
    results = campaign.run()                     # rates, worst runs, figures, SQL
    config = rj.load_campaign("quick.toml", overrides=["campaign.duration_s=1"])
    table = rj.run(config)                       # pandas: one row per run
    one = rj.simulate(config, 17)                # xarray.Dataset: time series of run 17
    chain = rj.explain(config, 17)               # pandas: which signal its fault reached when
    checks = rj.counterfactual(config)           # pandas: what further checks would have detected
    position, rotation = rj.forward_kinematics(jpos, "gold")
    software = rj.ControlSoftware()              # drive the control software alone
    model = rj.functional.load(config)           # the tick as pure functions of JAX

The names in `__all__` are public. Every other module and name is internal and may change with any
version. Names are imported when they are first used, so `import ravenjax` is fast.
"""

import ast
import importlib
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

# The stub states which module each name comes from, for this module and for type checkers.
_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_HOMES = {
    name.name: str(line.module)
    for line in _STUB.body
    if isinstance(line, ast.ImportFrom)
    for name in line.names
}
__all__ = sorted(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(
            f"module 'ravenjax' has no attribute {name!r}; it has {', '.join(__all__)}"
        )
    # The stub imports a public module, such as `functional`, from this package itself.
    if _HOMES[name] == __name__:
        return importlib.import_module(f"{__name__}.{name}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

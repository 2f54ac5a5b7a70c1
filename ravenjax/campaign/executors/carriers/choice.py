"""The executor that was asked for."""

from __future__ import annotations

from ravenjax.campaign.executors.local import Local
from ravenjax.campaign.executors.protocol import Executor
from ravenjax.errors import UserError, suggestion

EXECUTORS = ("local", "processes", "ray")


def executor(
    name: str | None = None, workers: int | None = None, ray_address: str | None = None
) -> Executor:
    """The executor of that name. Without one: what the other two speak for, else `local`. Raises
    UserError.
    """
    if name is None:
        name = "ray" if ray_address is not None else "local" if workers is None else "processes"
    if name not in EXECUTORS:
        raise UserError(
            f"--executor {name!r} is unknown: expected"
            f" {', '.join(EXECUTORS)}{suggestion(name, EXECUTORS)}"
        )
    if workers is not None and workers < 1:
        raise UserError(f"--workers {workers}: expected 1 or more")
    if name != "ray" and ray_address is not None:
        raise UserError(
            f"--ray-address {ray_address} belongs to --executor ray, got --executor {name}"
        )
    if name == "local":
        if workers is not None and workers > 1:
            raise UserError(
                f"--workers {workers} with --executor local, which is one process: its engine uses"
                " every core and GPU. Leave --workers out, or take --executor processes"
            )
        return Local()
    if name == "processes":
        from ravenjax.campaign.executors.carriers.processes import Processes

        return Processes(workers)
    from ravenjax.campaign.executors.carriers.cluster import Ray

    return Ray(workers, ray_address)

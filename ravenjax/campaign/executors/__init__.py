"""Chooses what computes a campaign: this process, or a Ray cluster."""

from ravenjax.campaign.executors.protocol import Executor, Local
from ravenjax.errors import UserError, describe_unknown_name

EXECUTORS = ("local", "ray")


def choose_executor(
    name: str | None = None, workers: int | None = None, ray_address: str | None = None
) -> Executor:
    """Return the executor `name`. Default: `ray` if workers or an address are given, else `local`.
    Raise UserError for arguments that contradict each other.
    """
    if name is None:
        name = "local" if workers is None and ray_address is None else "ray"
    if name not in EXECUTORS:
        raise UserError(f"--executor: {describe_unknown_name('executor', name, EXECUTORS)}")
    if workers is not None and workers < 1:
        raise UserError(f"--workers is {workers}, expected 1 or more")
    if name == "ray":
        from ravenjax.campaign.executors.ray_cluster import Ray

        return Ray(workers, ray_address)
    if ray_address is not None:
        raise UserError(f"--ray-address {ray_address} needs --executor ray, got --executor {name}")
    if workers is not None and workers > 1:
        raise UserError(
            f"--workers {workers} has no use with --executor local, which is one process that uses"
            " every core and GPU. Leave --workers out, or write --executor ray"
        )
    return Local()

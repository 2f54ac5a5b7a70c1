"""What a campaign file may say of a Raven-II, and what a campaign asks of it; see `ravenjax.campaign.prepared`."""

from ravenjax.robots.raven2.campaign.config import RavenConfig as Config
from ravenjax.robots.raven2.campaign.program import prepare
from ravenjax.robots.raven2.campaign.series import bases, series
from ravenjax.robots.raven2.loop.tick import TickParams as Params

__all__ = ["Config", "Params", "bases", "prepare", "series"]

"""How far a campaign is, for whoever watches it."""

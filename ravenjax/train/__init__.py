"""The training session: the campaigns' tick, once a millisecond, for a person."""

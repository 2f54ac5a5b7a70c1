"""Training sessions: run the campaigns' tick once a millisecond, driven by a person."""

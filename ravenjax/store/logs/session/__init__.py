"""Files of a training session: session.json, session.mcap, and a list of its events in words."""

"""Files of a training session: session.json, session.mcap, and a readable list of its events."""

"""The files of a training session: session.json, session.mcap, and its events in words."""

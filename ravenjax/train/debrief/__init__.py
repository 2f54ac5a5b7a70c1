"""Makes the debrief of a session: a page with charts and measures."""

"""The debrief of a session: a page, its charts and its measures."""

"""The debrief of a session: a page, its figures and its words."""

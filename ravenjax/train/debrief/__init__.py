"""Makes the debrief of a training session: a page with charts and measures."""

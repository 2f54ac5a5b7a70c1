"""Runs one training session: compiles and simulates it, reads hands, arms hazards, fills frames."""

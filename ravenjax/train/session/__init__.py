"""Runs one training session: compiles the tick, reads the hands, arms hazards and fills frames."""

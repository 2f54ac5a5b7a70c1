"""Runs one training session: compiles the tick, moves the hands, starts hazards, fills frames."""

"""Runs one training session: compiles the tick, moves the operator's hands, starts hazards, and
writes the numbers of each tick into a frame."""

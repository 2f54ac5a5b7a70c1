"""Published experiments run again: what was published, what ravenjax predicts, side by side."""

"""What the operator's reaction to the cue changes: pairs of runs, and their charts."""

"""Whether the cue would have helped: the same faults with an operator who reacts and without."""

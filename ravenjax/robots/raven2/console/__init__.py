"""The operator's console: motion of the hands, packets, reaction to the haptic cue."""

"""The haptic cue: threshold, gains, what is missed and what disturbs."""

"""The cue's force moves the hand: what that changes of what faults do, and what it does not."""

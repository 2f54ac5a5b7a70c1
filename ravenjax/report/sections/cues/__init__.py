"""The haptic cue in a report: every threshold and gain on the same runs, and which one the data
would choose.
"""

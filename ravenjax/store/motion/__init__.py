"""Drives a campaign with recorded hand motion.

A recording holds the desired poses of the instrument's tip, as a table, a bag or a stream of
packets. `docs/how-to/recordings.md` defines the files, and what is done with the motion.
"""

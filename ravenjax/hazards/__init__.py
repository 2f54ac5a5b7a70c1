"""The hazard library as data: what can go wrong with this robot, from console to cables, and what
is known of each.

`library` reads and checks it, `expansion` turns a campaign's group that names hazards into plain
groups, `ranges` says what each channel does when nothing is wrong, `listing` puts hazards into
words.
"""

"""Holds the hazard library: what can go wrong with this robot, from console to cables.

`library` reads and checks the data. `expansion` turns a campaign's group that names hazards into
plain groups. `ranges` holds the normal range of each channel. `listing` puts hazards into words.
"""

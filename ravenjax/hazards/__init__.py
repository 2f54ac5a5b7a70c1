"""The hazard library: published hazards of the Raven-II, from the console to the cables.

`library` reads and checks the hazards. `expansion` converts a campaign's group that names hazards
into ordinary groups of runs. `listing` describes hazards as text.
"""

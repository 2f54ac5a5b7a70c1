"""Analyses of a campaign or of a recording, one a folder."""

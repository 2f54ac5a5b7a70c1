"""Writes reports on result folders: an HTML page, figures for print, and a comparison of two."""

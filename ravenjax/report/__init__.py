"""Writes reports about a result folder: an HTML page, figures for print, and a comparison of two
folders.
"""

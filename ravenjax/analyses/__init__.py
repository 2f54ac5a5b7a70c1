"""Analyses of campaigns and of recordings. Each subfolder contains one analysis."""

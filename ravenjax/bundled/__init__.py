"""Campaigns and robot models that are installed with the package."""

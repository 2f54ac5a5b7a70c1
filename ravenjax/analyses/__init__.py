"""Analyses campaigns and recordings; each folder holds one analysis."""

"""Bundled files in an installed package: campaigns and models."""

"""Reads console profiles: TOML files that describe a console's packets."""

"""Expands groups into the fault table, and converts it to an engine's inputs."""

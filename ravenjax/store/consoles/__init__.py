"""Console profiles: bundled ones by name, and files of the user."""

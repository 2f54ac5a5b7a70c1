"""Console profiles: bundled ones by name, and files of one's own."""

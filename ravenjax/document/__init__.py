"""Charts, tables and pages, the same in a browser and in print. They need no result table."""

"""Evidence for a risk file: tables and an argument whose numbers lead to runs and checksums."""

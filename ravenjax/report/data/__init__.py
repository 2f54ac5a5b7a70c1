"""What the report counts: facts of every run, asked of the result table by SQL."""

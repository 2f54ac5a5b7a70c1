"""Number types that the code of a tick is written in: scalars, vectors, records and paths."""

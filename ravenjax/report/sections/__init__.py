"""The sections of the report, one module or package each."""

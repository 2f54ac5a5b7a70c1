"""Control software and virtual robot as a C library, as texts."""

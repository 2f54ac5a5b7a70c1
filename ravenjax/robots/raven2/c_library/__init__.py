"""Control software and virtual robot as a C library: header, code and example; the caller writes
the files.
"""

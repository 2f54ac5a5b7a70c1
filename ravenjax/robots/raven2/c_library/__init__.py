"""Control software and virtual robot as a C library: header, code, example. Who asks for them
writes the files.
"""

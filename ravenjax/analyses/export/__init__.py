"""Control software and virtual robot in other people's hands: files for C programs."""

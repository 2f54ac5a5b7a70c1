"""A recorded robot and the virtual one that is driven as it was."""

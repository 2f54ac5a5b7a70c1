"""The control software driven alone."""

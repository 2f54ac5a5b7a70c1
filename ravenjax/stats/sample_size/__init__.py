"""How many runs a precision needs, and when to stop early."""

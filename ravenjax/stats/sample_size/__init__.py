"""Plans how many runs a precision needs, and decides when to stop early."""

"""Links to robots and consoles over a network."""

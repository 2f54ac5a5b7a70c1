"""What ticks are written in: numbers, vectors and records of them, and paths to them."""

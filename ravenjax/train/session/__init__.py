"""One training session: what it compiles and simulates, hands in, hazards armed, frames out."""

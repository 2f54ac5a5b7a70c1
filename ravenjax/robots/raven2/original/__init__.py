"""Geometry by the operations of the original, in their order and in double precision."""

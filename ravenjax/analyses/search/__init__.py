"""Searches for the smallest harmful fault, the inputs that matter most, and the probability of rare
events."""

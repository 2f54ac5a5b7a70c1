"""Searches for the smallest harmful fault, decisive inputs, and the probability of rare events."""

"""Finds the smallest harmful fault, the inputs that matter most, and the rates of rare events."""

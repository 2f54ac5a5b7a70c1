"""Computes the stages of the control software, and the PLC. Signals have raven2's names."""

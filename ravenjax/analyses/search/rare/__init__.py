"""Estimates the probability of a rare event, by subset simulation and by plain Monte Carlo."""

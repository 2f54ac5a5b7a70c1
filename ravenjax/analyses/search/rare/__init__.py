"""Probability of a rare event: subset simulation beside plain Monte Carlo."""

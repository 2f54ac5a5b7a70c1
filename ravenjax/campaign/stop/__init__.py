"""Runs campaigns that stop early, and stores the decision of each look."""

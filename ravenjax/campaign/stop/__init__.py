"""Runs campaigns that stop early when their rates are precise enough, and records each decision."""

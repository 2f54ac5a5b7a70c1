"""Campaigns that stop when they know enough: what is kept of finished rows, and each decision."""

"""Queries, checks, merges and locks the folders with the results of campaigns."""

"""Derives facts about every run from the result table with SQL, for the report to count."""

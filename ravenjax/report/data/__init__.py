"""Derives facts about every run from the result table, with SQL. The report counts the facts."""

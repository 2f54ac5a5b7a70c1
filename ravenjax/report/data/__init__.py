"""Derives facts about every run from the result table, with SQL queries. The report counts these
facts.
"""

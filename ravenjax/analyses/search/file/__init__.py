"""The search file: its section [search], its one group as a template of runs, the outcome that
it asks for.
"""

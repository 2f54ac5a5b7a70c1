"""Campaigns declared and results looked at in Python, as in a notebook. Public names are those
of `import ravenjax`.
"""

"""Makes charts, tables and pages that look the same in a browser and in print. Needs no result
table.
"""

"""Makes charts, tables and HTML pages that look the same in a browser and in print.

The functions know nothing of campaigns, so any data can be shown.
"""

"""Documents that show results: charts, tables and pages, alike in a browser and in print. Needs
no result to do so.
"""

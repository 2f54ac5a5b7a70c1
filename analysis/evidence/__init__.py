"""What a risk file asks of campaigns: tables and an argument whose every number leads to runs
and checksums.
"""

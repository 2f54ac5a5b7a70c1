"""Reads recordings of operators' hands and converts them into motions for a campaign.

A recording contains the desired poses of the instrument's tip, as a table, a bag or a stream of
packets. `docs/how-to/recordings.md` defines the files and each step of the conversion.
"""

"""Defines the keys of campaign files, checks their values, and words error messages."""

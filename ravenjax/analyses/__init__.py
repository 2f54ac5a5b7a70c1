"""Analyses of campaigns and of recordings. Each module and each subfolder contains one."""

"""The error without a fault: the study at four scales, its segments, its drawings."""

"""Finding what matters: the smallest fault that does harm, the parameters that decide, how rare
a rare outcome is.
"""

"""The smallest fault that does harm: a scan, then bisection of every bracket; its figure and its
words.
"""

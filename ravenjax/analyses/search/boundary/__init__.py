"""Finds the smallest harmful fault, by a scan and then bisection of every bracket."""

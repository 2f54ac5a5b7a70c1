"""The smallest harmful fault: a scan, then bisection of every bracket."""

"""Motion without a fault in a report: golden runs, and the recorded operator before and after."""

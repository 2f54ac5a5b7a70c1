"""From fault to failure: explained runs one by one and together."""

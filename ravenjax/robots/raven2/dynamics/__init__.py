"""The links of an arm as rigid bodies."""

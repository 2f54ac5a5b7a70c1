"""Who computes a campaign's chunks: this process, others of this machine, a cluster."""

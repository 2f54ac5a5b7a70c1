"""Two groups compared: independent, run by run, by clusters; and how large a difference is."""

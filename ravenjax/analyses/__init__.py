"""Contains analyses of a campaign or of a recording, one per folder."""

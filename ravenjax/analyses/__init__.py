"""Questions asked of a campaign or of a recording; each folder answers one."""

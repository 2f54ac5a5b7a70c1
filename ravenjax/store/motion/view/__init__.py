"""A recorded motion as a person sees it: in words, and as the tip's course."""

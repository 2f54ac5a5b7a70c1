"""Maps of what a campaign swept: which inputs it varied, counts over pairs of them, and the
panels drawn.
"""

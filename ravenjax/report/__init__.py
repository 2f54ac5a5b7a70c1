"""The report of a result folder: the page, figures for print, and the comparison of two results."""

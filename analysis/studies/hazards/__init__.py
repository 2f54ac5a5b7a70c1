"""Published hazards and injections run again: the library, and the list of SAFECOMP 2015;
outcome classes compared.
"""

"""Measures how an outcome depends on its inputs, by rates and by sensitivity indices."""

"""Implements `ravenjax study`: compares groups of training sessions."""

"""Reads result folders by SQL, and checks, merges and locks them."""

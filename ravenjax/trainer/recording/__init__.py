"""What a session writes while it runs, read back."""

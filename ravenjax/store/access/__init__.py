"""Result folders as others use them: read by SQL, checked, merged, locked."""

"""Fixtures of recorded motions."""

import pytest


@pytest.fixture
def parquet(tmp_path):
    """Writes a table and returns its path."""

    def write(frame):
        path = tmp_path / "motion.parquet"
        frame.to_parquet(path)
        return path

    return write

"""The browser that tests use."""

import shutil

import pytest

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
NEEDED = pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium on the path (apt-get install chromium)"
)

# a container has no sandbox, and its graphics are software
ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
PATIENCE_MS = 120_000

"""Reads the settings of matplotlib for figures in print and for charts of HTML pages."""

from pathlib import Path
from typing import Any

import matplotlib

INK, SOFT = "#3a424c", "#8a8f96"


def _read(name: str) -> dict[Any, Any]:
    path = Path(__file__).with_name(name)
    return dict(matplotlib.rc_params_from_file(path, use_default_template=False))


STYLE = _read("figure.mplstyle")
PAGE_STYLE = STYLE | _read("page.mplstyle")

"""Hook of mkdocs: pages of bundled campaigns to explore, beside the documentation that embeds them."""  # noqa: E501

from __future__ import annotations

from pathlib import Path
from typing import Any

from ravenjax.analyses.explorer import gallery


def on_post_build(config: Any, **_: Any) -> None:
    """Write the gallery of the campaigns that the configuration names into the site."""
    folder = Path(config["site_dir"]) / "gallery"
    gallery.build_gallery(folder, config["extra"]["gallery"])

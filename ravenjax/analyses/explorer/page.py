"""Writes an HTML page with which a browser simulates a campaign's robot, without a network."""

import base64
import json
import re
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from ravenjax.analyses.explorer import program, words
from ravenjax.campaign import loading
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.loading import validate_tables
from ravenjax.document import html
from ravenjax.store import files, manifest

PREFIX = "page/"
"""Prefix of module names. An import map cannot replace names that begin with a dot."""
_IMPORT = re.compile(
    r'(\bfrom\s+|\bimport\s+|\bimport\(|\bimport\.meta\.resolve\()"\./([\w-]+\.js)"'
)

FILE = "explore.html"
SUFFIX = ".explore.html"


def build_page(source: str | Path, out: Path | None = None) -> Path:
    """Write the page of a campaign file, a bundled campaign or a result folder. Return its path.

    out: the path; by default `explore.html` in a result folder, or `NAME.explore.html` in the
    current folder for a campaign. Raise UserError and StoreError.
    """
    folder = Path(source)
    if folder.is_dir():
        record = manifest.read_manifest(folder)
        config = validate_tables(record.config, folder / manifest.FILE)
        runs = words.list_runs(folder, record)
        default_path = folder / FILE
    else:
        config, runs = loading.load_campaign(source, runs=False), None
        default_path = Path(config.campaign.name + SUFFIX)
    path = out or default_path
    files.write_text(path, render_page(config, runs))
    return path


def render_page(config: CampaignConfig, runs: dict[str, Any] | None = None) -> str:
    """Return the page of a campaign as HTML. `runs`: result of `words.list_runs`; None: no runs.
    Raise UserError for a campaign that a page cannot compute.
    """
    package = resources.files("ravenjax.analyses.explorer")
    describe_figure = getattr(config.robot.part("campaign"), "describe_figure", lambda: None)
    data = {
        "campaign": words.describe_campaign(config),
        "figure": describe_figure(),
        "program": program.describe_program(config),
        "table": runs,
    }
    return fill(
        "page.html.j2",
        campaign=data["campaign"],
        modules=html.escape_json(import_map(package / "static")),
        data={
            name: json.dumps(files.json_values(value), separators=(",", ":"))
            for name, value in data.items()
        },
        prefix=PREFIX,
    )


def fill(template: str, **values: Any) -> str:
    """Return the text of a template of this package with these values."""
    templates = html.template_environment("ravenjax.analyses.explorer")
    return templates.get_template(template).render(values)


def import_map(folder: Traversable) -> str:
    """Return JSON of an import map with every JavaScript module of a folder as a data URL.

    The page needs the map, because a page opened from a file cannot import other files. In the
    modules, imports and `import.meta.resolve` of `./name.js` are replaced by names of the map.
    """
    modules = {}
    for file in sorted(folder.iterdir(), key=lambda file: file.name):
        if file.name.endswith(".js"):
            text = _IMPORT.sub(rf'\1"{PREFIX}\2"', file.read_text(encoding="utf-8"))
            content = base64.b64encode(text.encode()).decode()
            modules[PREFIX + file.name] = f"data:text/javascript;charset=utf-8;base64,{content}"
    return json.dumps({"imports": modules})

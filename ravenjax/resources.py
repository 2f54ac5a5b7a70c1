"""Finds bundled campaigns and models, and reads data files and templates of the package.

A campaign or model is searched for at its path, in the working directory, and in the package.
"""

import tomllib
from pathlib import Path
from typing import Any

_CHECKOUT = Path(__file__).resolve().parents[1]
# The folder exists in a wheel only.
_BUNDLED = Path(__file__).resolve().with_name("bundled")


def find_resource(kind: str, name: str | Path) -> Path:
    """Find the file `name` of a kind ("campaigns" or "models") and return its path. The search
    order is: the path `name`, the folder ./<kind>, the folder beside the package (in a checkout),
    the folder inside the package (in a wheel). Raise FileNotFoundError with this list.
    """
    places = [Path(name), Path.cwd() / kind / name, _CHECKOUT / kind / name, _BUNDLED / kind / name]
    for place in places:
        if place.is_file():
            return place.resolve()
    tried = "\n".join(f"  {place}" for place in places)
    raise FileNotFoundError(f"{name}: found no such file in {kind}. Searched:\n{tried}")


def read_tables(module: str, name: str) -> dict[str, Any]:
    """Return the content of a TOML file in the folder of a module. module: its `__file__`."""
    return tomllib.loads((Path(module).parent / name).read_text(encoding="utf-8"))


def render_rows(template: Path, **values: Any) -> list[tuple[str, str]]:
    """Render a Jinja template and return (name, text) of each line `name | text`."""
    lines = (line.partition(" | ") for line in render_text(template, **values).splitlines())
    return [(name, content) for name, bar, content in lines if bar]


def render_text(*templates: Path, **values: Any) -> str:
    """Render Jinja templates, as one text: a template can use what those before it set."""
    # Most processes need no template, and the import is slow.
    import jinja2

    return jinja2.Template(
        "".join(template.read_text(encoding="utf-8") for template in templates),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    ).render(values)


def find_model(name: str | Path) -> Path:
    """Return the path of a file of models/."""
    return find_resource("models", name)


def list_resources(kind: str, pattern: str) -> list[Path]:
    """Return the files of the bundled folder `kind` that match the glob `pattern`, by name."""
    for folder in (_CHECKOUT / kind, _BUNDLED / kind):
        if folder.is_dir():
            return sorted(folder.glob(pattern))
    return []

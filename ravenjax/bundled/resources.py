"""Finds files of bundled campaigns and models.

A file is searched for at an explicit path, then in the working directory, then in the installed
package.
"""

import tomllib
from pathlib import Path
from typing import Any

_BUNDLED = Path(__file__).resolve().parent
_CHECKOUT = _BUNDLED.parents[1]


def find_resource(kind: str, name: str | Path) -> Path:
    """Return the path of data file `name` of folder `kind` ("campaigns" or "models").

    Searches the path as given, ./<kind>, the folder beside the package (a checkout) and the folder
    inside it (a wheel), in this order. Raises FileNotFoundError that lists each place tried.
    """
    places = [Path(name), Path.cwd() / kind / name, _CHECKOUT / kind / name, _BUNDLED / kind / name]
    for place in places:
        if place.is_file():
            return place.resolve()
    tried = "\n".join(f"  {place}" for place in places)
    raise FileNotFoundError(f"{name}: no such file in {kind}. Looked at:\n{tried}")


def read_tables(module: str, name: str) -> dict[str, Any]:
    """Return the content of a TOML file beside a module, which is given by its `__file__`."""
    return tomllib.loads((Path(module).parent / name).read_text(encoding="utf-8"))


def render_rows(template: Path, **values: Any) -> list[tuple[str, str]]:
    """Return (name, text) of each line `name | text` that a template of Jinja gives."""
    lines = (line.partition(" | ") for line in render_text(template, **values).splitlines())
    return [(name, content) for name, bar, content in lines if bar]


def render_text(template: Path, **values: Any) -> str:
    """Return the text that a template of Jinja gives."""
    # Imported here because few processes describe anything.
    import jinja2

    return jinja2.Template(
        template.read_text(encoding="utf-8"),
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

"""JavaScript modules of a folder inside one page: a page opened from a file may import no module by
its address.

An import map names each module's text as a data URL; imports of `./name.js`, and
`import.meta.resolve` of it, become such of that name.
"""

from __future__ import annotations

import base64
import json
import re
from importlib.resources.abc import Traversable

PREFIX = "page/"
"""Before a module's name in the map; a bare name is what an import map may give an address."""
_IMPORT = re.compile(
    r'(\bfrom\s+|\bimport\s+|\bimport\(|\bimport\.meta\.resolve\()"\./([\w-]+\.js)"'
)


def import_map(folder: Traversable) -> str:
    """JSON of an import map with every module of the folder."""
    modules = sorted(
        (file for file in folder.iterdir() if file.name.endswith(".js")), key=lambda file: file.name
    )
    return json.dumps(
        {
            "imports": {
                PREFIX + file.name: _url(file.read_text(encoding="utf-8")) for file in modules
            }
        }
    )


def _url(source: str) -> str:
    text = _IMPORT.sub(lambda found: f'{found[1]}"{PREFIX}{found[2]}"', source)
    return "data:text/javascript;charset=utf-8;base64," + base64.b64encode(text.encode()).decode()

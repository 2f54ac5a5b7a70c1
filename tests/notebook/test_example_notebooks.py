"""The notebooks of the documentation run from top to bottom and show what they promise."""

from pathlib import Path

import nbclient
import nbformat
import pytest

DOCS = Path(__file__).parents[2] / "docs"
NOTEBOOKS = sorted(DOCS.rglob("*.ipynb"))
SHOWS = {
    "campaign-in-python": {"text/html": 5, "image/svg+xml": 1},
    "figures-of-your-own": {"text/html": 3, "image/png": 1, "image/svg+xml": 1},
}
"""How many outputs of each kind a notebook has at least."""


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3")
    client.execute(cwd=str(tmp_path))
    outputs = [one for cell in notebook.cells if cell.cell_type == "code" for one in cell.outputs]
    assert not [one for one in outputs if one.output_type == "error"]
    kinds = [kind for one in outputs for kind in one.get("data", {})]
    for kind, least in SHOWS[path.stem].items():
        assert kinds.count(kind) >= least, (kind, kinds)

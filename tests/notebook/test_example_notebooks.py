"""The notebooks of the documentation run from top to bottom, show what they promise, and are
stored without outputs.
"""

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


def test_every_notebook_is_looked_at():
    assert {path.stem for path in NOTEBOOKS} == set(SHOWS)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_stored_without_outputs_and_linked(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code and all(not cell.outputs and cell.execution_count is None for cell in code)
    assert path.stat().st_size < 10_000
    assert any(path.name in page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))


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

"""The workbook has the cells of the tables: numbers as numbers, all else as the text that it is."""

import csv
import re
import sys
import xml.etree.ElementTree as ET
import zipfile

import pytest
import synthetic_results as synthetic

from evidence import workbook, writing
from evidence.record import NOTICE
from ravenjax import cli

RUNS = 120
SPACE = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("workbook") / "result"
    return synthetic.folder(place, synthetic.frame(RUNS), synthetic.manifest(RUNS))


def sheets(path):
    """Sheet -> rows of cells: (column letters, float) or (column letters, text); no formulas are
    in it.
    """
    with zipfile.ZipFile(path) as file:
        names = [
            sheet.get("name")
            for sheet in ET.fromstring(file.read("xl/workbook.xml")).iter(f"{SPACE}sheet")
        ]
        shared = ET.fromstring(file.read("xl/sharedStrings.xml")).iter(f"{SPACE}si")
        words = ["".join(text.itertext()) for text in shared]
        trees = [
            ET.fromstring(file.read(f"xl/worksheets/sheet{k + 1}.xml")) for k in range(len(names))
        ]
    assert not [formula for tree in trees for formula in tree.iter(f"{SPACE}f")]

    def read(cell):
        value = cell.findtext(f"{SPACE}v")
        letters = re.sub(r"\d", "", cell.get("r"))
        return letters, words[int(value)] if cell.get("t") == "s" else float(value)

    return {
        name: [
            [read(cell) for cell in row.iter(f"{SPACE}c") if cell.find(f"{SPACE}v") is not None]
            for row in tree.iter(f"{SPACE}row")
        ]
        for name, tree in zip(names, trees, strict=True)
    }


def test_cells_are_those_of_the_tables(folder, tmp_path):
    pytest.importorskip("xlsxwriter")
    assert cli.main(["evidence", str(folder), "--out", str(tmp_path), "--xlsx"]) == 0
    book = sheets(tmp_path / workbook.FILE)
    assert list(book) == ["read me", *(name.removesuffix(".csv") for name in writing.GOALS)]
    assert book["read me"][0] == [("A", NOTICE)]
    letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
    for name in writing.GOALS:
        with open(tmp_path / name, encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file)
        table = book[name.removesuffix(".csv")]
        assert [text for _, text in table[0]] == header and len(table) == 1 + len(rows) > 3
        for cells, row in zip(table[1:], rows, strict=True):
            own = dict(cells)
            for letter, title, text in zip(letters, header, row, strict=False):
                value = own.pop(letter, "")
                if isinstance(value, float):
                    assert value == float(f"{float(text):.16g}") and title not in (
                        "run_id",
                        "example_runs",
                        "part_sha256",
                        "group",
                    )
                else:
                    assert value == text and not (text and title.startswith("rate_"))
            assert not own
    assert cli.main(["evidence", "--check", str(tmp_path)]) == 0
    with open(tmp_path / workbook.FILE, "ab") as file:
        file.write(b"more")
    assert cli.main(["evidence", "--check", str(tmp_path)]) == 1
    assert cli.main(["evidence", str(folder), "--out", str(tmp_path)]) == 0
    assert not (tmp_path / workbook.FILE).exists()  # it would have been that of before


def test_without_the_extra_it_is_said_what_to_install(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "xlsxwriter", None)
    assert cli.main(["evidence", str(folder), "--out", str(tmp_path / "new"), "--xlsx"]) == 2
    assert "pip install 'ravenjax[xlsx]'" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "new").exists()

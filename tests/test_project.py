"""What surrounds the package: metadata, links between pages."""

import re
from pathlib import Path

import pytest
import snippets

import ravenjax

ROOT = snippets.ROOT
LINKED = [
    ROOT / "README.md",
    ROOT / ".github/CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]


def test_the_package_is_typed():
    assert (Path(ravenjax.__file__).parent / "py.typed").is_file()
    assert "Typing :: Typed" in snippets.PROJECT["classifiers"]


@pytest.mark.parametrize("page", LINKED, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(
        r"^```.*?^```$|`[^`\n]+`", "", page.read_text(encoding="utf-8"), flags=re.M | re.S
    )
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        assert target.startswith("https://") or (page.parent / target).exists(), target


def test_contributing_names_what_there_is():
    text = (ROOT / ".github/CONTRIBUTING.md").read_text(encoding="utf-8")
    for words in snippets.calls(text, "ravenjax"):
        snippets.require_command_line(words)
    for extra in re.findall(r"'\.\[([\w,]+)\]'", text):
        assert set(extra.split(",")) <= set(snippets.PROJECT["optional-dependencies"])

"""What surrounds the package: metadata, hooks, hosted checks, links between pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import snippets

import ravenjax

ROOT = snippets.ROOT
CHECKS = (ROOT / ".ci/run").read_text(encoding="utf-8")
LINKED = [
    ROOT / "README.md",
    ROOT / ".github/CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]


def test_the_package_is_typed():
    assert (Path(ravenjax.__file__).parent / "py.typed").is_file()
    assert "Typing :: Typed" in snippets.PROJECT["classifiers"]


def test_hooks_are_among_the_checks():
    yaml = pytest.importorskip("yaml")
    (local,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))[
        "repos"
    ]
    entries = {hook["entry"].removesuffix(" --fix") for hook in local["hooks"]}
    assert entries == {"ruff check", "ruff format", "lint-imports", "pyright"}
    for entry in entries:
        assert f".venv/bin/{entry}" in CHECKS


def test_hosted_checks_are_the_same():
    yaml = pytest.importorskip("yaml")
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))["jobs"]
    commands = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    fast = "$(grep -m1 'pytest -n auto' README.md)"
    assert fast in CHECKS and commands == [".ci/run", f'bash -euo pipefail -c "{fast}"']


@pytest.mark.parametrize("page", LINKED, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        assert target.startswith("https://") or (page.parent / target).exists(), target


def test_contributing_names_what_there_is():
    text = (ROOT / ".github/CONTRIBUTING.md").read_text(encoding="utf-8")
    for words in snippets.calls(text, "ravenjax"):
        snippets.require_command_line(words)
    for extra in re.findall(r"'\.\[([\w,]+)\]'", text):
        assert set(extra.split(",")) <= set(snippets.PROJECT["optional-dependencies"])

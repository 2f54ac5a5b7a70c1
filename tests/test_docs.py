"""The documentation is true: its examples run, its reference is what the code says now, and the
site builds.

The examples of a page are one session of a reader, from top to bottom in one empty folder: a block
with a title is a file of that name, and Python and shell blocks are run. What is done otherwise
than a reader would:

- installing (`python3 -m venv`, `source`, `pip`) is not run; that what is installed exists is
  another test;
- a session in the browser gets a free port, lasts twelve seconds and does not wait for Ctrl-C;
- `ravenjax fault-free` adds 36 seconds of motion.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import pytest
import snippets

from ravenjax.analyses.search.file import config as searches
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection import json_schema as campaigns
from ravenjax.errors import tables_of
from ravenjax.robots import find_robot
from ravenjax.robots.raven2 import ROBOT
from ravenjax.train.scenario import loading as scenarios

DOCS = snippets.ROOT / "docs"
GENERATED = DOCS / "reference"
PAGES = sorted(path for path in DOCS.rglob("*.md") if GENERATED not in path.parents)
TEXTS = {str(path.relative_to(DOCS)): path.read_text(encoding="utf-8") for path in PAGES}
RUN = [
    name
    for name, text in TEXTS.items()
    if snippets.blocks(text, "bash") or snippets.blocks(text, "python")
]
SETUP = re.compile(r"^(python3 -m venv|source|pip) .*$", re.M)
HOURS = re.compile(r"(?<=fault-free )(.*)--hours [\d.]+")
# its time begins as somebody drives
SESSION = " --port 0 --linger 0 --set duration_s=12 --script release"


def of_language(*languages):
    """(page, snippet) of every block in one of these languages."""
    return [
        pytest.param(name, one, id=f"{name}-{number}")
        for name, text in TEXTS.items()
        for number, one in enumerate(snippets.snippets(text))
        if one.language in languages
    ]


def commands(program):
    return [
        pytest.param(words, id=f"{name}: {' '.join(words)}")
        for name, text in TEXTS.items()
        for words in snippets.calls(text, program)
    ]


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(("page", "snippet"), of_language("bash"))
def test_shell_is_shell(page, snippet):
    snippets.require_shell(snippet.text)


@pytest.mark.parametrize("words", commands("ravenjax"))
def test_command_lines_are_understood(words):
    snippets.require_command_line(words)


@pytest.mark.parametrize("words", commands("pip"))
def test_what_is_installed_exists(words):
    snippets.require_installable(words)


@pytest.mark.parametrize(("page", "snippet"), of_language("python"))
def test_python_uses_names_that_exist(page, snippet):
    snippets.require_names(snippet.text)


@pytest.mark.parametrize(("page", "snippet"), of_language("toml"))
def test_files_are_valid(page, snippet, tmp_path, monkeypatch):
    """By the JSON Schema and by the loader, beside the page's other files; a recording is read
    when the page is run.
    """
    from ravenjax.analyses.search.file import loading as search_loading
    from ravenjax.campaign import loading
    from ravenjax.store import consoles
    from ravenjax.train import scenario

    assert snippet.title, "name the file: ```toml title=..."
    monkeypatch.chdir(tmp_path)
    for one in snippets.snippets(TEXTS[page]):
        if one.title:
            (tmp_path / one.title).write_text(one.text, encoding="utf-8")
    raw = tomllib.loads(snippet.text)
    if "source" in raw:
        consoles.load_profile(snippet.title)
        return
    if "search" in raw:
        schema, load = searches.json_schema_of(ROBOT), search_loading.from_dict
    else:
        schema, load = (
            (campaigns.campaign_schema(robot_of(raw)), loading.from_dict)
            if "campaign" in raw
            else (scenarios.json_schema(), scenario.from_dict)
        )
    jsonschema.Draft202012Validator(schema).validate(raw)
    load(raw)


def robot_of(raw):
    return find_robot(raw["campaign"].get("robot", "raven2"), Path.cwd())


def in_the_browser(line):
    """Whether a line of shell starts a session that a reader drives."""
    return line.startswith("ravenjax train") and "--headless" not in line


def run_page(name, folder):
    """Every example of a page, in order."""
    tools = folder / "bin"
    tools.mkdir()
    for program, words in {"ravenjax": '-m ravenjax.cli "$@"', "python": '"$@"'}.items():
        shim = tools / program
        shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words}\n', encoding="utf-8")
        shim.chmod(0o755)
    at = folder / "reader"
    at.mkdir()
    path = os.pathsep.join([str(tools), os.environ["PATH"]])
    packages = os.pathsep.join(filter(None, [str(snippets.ROOT), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "PATH": path, "PYTHONPATH": packages}
    for one in snippets.snippets(TEXTS[name]):
        if one.title:
            (at / one.title).write_text(one.text, encoding="utf-8")
            if re.search(rf'(file|dac) ?= ?"?{re.escape(one.title)}', TEXTS[name]):
                continue  # a part of a campaign, no program
        if one.language == "python":
            command = [sys.executable, "-c", one.text]
        elif one.language == "bash":
            lines = SETUP.sub("", one.text).splitlines()
            script = "\n".join(
                HOURS.sub(r"\1--hours 0.01", line.partition(" # ")[0])
                + SESSION * in_the_browser(line)
                for line in lines
            )
            command = ["bash", "-euo", "pipefail", "-c", script]
        else:
            continue
        done = subprocess.run(
            command, cwd=at, env=environment, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 0, f"{one.text}\n{done.stdout}\n{done.stderr}"
    return at


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.slow
@pytest.mark.parametrize("page", RUN)
def test_examples_run(page, tmp_path):
    run_page(page, tmp_path)


def test_the_reference_is_what_the_code_says():
    script = snippets.ROOT / ".ci/reference_pages.py"
    spec = importlib.util.spec_from_file_location("reference_pages", script)
    assert spec is not None and spec.loader is not None
    reference_pages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reference_pages)
    files = reference_pages.files()
    assert set(GENERATED.iterdir()) == {path for path in files if path.parent == GENERATED}
    for path, text in files.items():
        assert path.read_text(encoding="utf-8") == text, f"write it anew: {reference_pages.COMMAND}"


def test_every_key_of_a_campaign_has_a_meaning():
    tables = {path: model for path, _, model in tables_of(CampaignConfig)}
    for path, model in tables.items():
        for name, field in model.model_fields.items() if path else ():
            assert (*path, name) in tables or field.description, (*path, name)


def test_modules_of_the_way_of_a_fault_exist():
    modules = re.findall(r"^\| `([\w.]+)` \|", TEXTS["explanation/walk.md"], re.M)
    assert len(modules) > 20
    assert all(importlib.util.find_spec(f"ravenjax.{module}") for module in modules)


def test_every_page_is_in_the_navigation():
    navigation = (snippets.ROOT / ".mkdocs.yml").read_text(encoding="utf-8")
    for path in sorted(DOCS.rglob("*.md")):
        assert f": {path.relative_to(DOCS)}\n" in navigation, path


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("material") is None, reason="mkdocs-material is not installed"
)
def test_the_site_builds(tmp_path):
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "-f",
        ".mkdocs.yml",
        "-d",
        str(tmp_path / "site"),
    ]
    done = subprocess.run(command, cwd=snippets.ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (
        "Overdrive"
        in (tmp_path / "site/reference/campaigns.html").read_text(encoding="utf-8").title()
    )
    assert (tmp_path / "site/index.html").is_file() and Path(
        tmp_path / "site/outcomes.svg"
    ).is_file()
    assert 'src="../gallery/index.html"' in (tmp_path / "site/how-to/explore.html").read_text(
        encoding="utf-8"
    )
    assert (tmp_path / "site/gallery/quick.html").is_file() and (
        tmp_path / "site/gallery/index.html"
    ).is_file()

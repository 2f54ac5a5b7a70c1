"""Writes the report of a result folder as one HTML page that can be read without a network."""

import contextlib
import functools
import json
import re
from pathlib import Path

import jinja2
from markupsafe import Markup, escape

from ravenjax.document import html
from ravenjax.hazards import naming
from ravenjax.outcomes import events
from ravenjax.report import downloads, wording
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section, all_sections, answers, tables
from ravenjax.store import manifest as manifests
from ravenjax.store.files import write_text
from ravenjax.store.manifest import Manifest

FILE = "report.html"


def build_report(folder: Path) -> Path:
    """Write report.html into a result folder and return its path.

    Raises StoreError if the folder holds no readable result.
    """
    manifest = manifests.read_manifest(folder)
    with contextlib.closing(Runs.open(folder, manifest)) as runs:
        text = render_report(runs, manifest, folder)
    path = folder / FILE
    write_text(path, text)
    return path


def render_report(runs: Runs, manifest: Manifest, folder: Path) -> str:
    """Return the HTML page of a result table. folder: result folder, which commands name."""
    cue = manifest.cues[manifest.verdict_cue] if manifest.cues else None
    head = tables.headline_counts(runs, manifest)
    common = {
        "manifest": manifest,
        "cue": cue,
        "threshold": f"{cue.threshold_mm:g} mm " if cue else "",
        "limit": f"{manifest.limit_mm:g} mm",
        "robot": manifest.robot,
        "head": head,
        "evaded": head["evaded"],
        "faults": "distinct fault" + ("s" if head["evaded"].n != 1 else ""),
        "free": runs.motions,
        "sampled": runs.sampled(),
        "frame_rows": runs.rows,
    }

    def body(section: Section):
        # Returns the HTML of one section, or None if the section has no content.
        content = section.content(runs, folder)
        if content is None:
            return None
        template = _environment().get_template(f"{section.name}.html.j2")
        return Markup(template.render(common | content))

    bodies = {section: text for section in all_sections() if (text := body(section)) is not None}
    first = body(answers.FIRST_PAGE)
    text = _environment().get_template("page.html.j2").render(common, answers=first, bodies=bodies)
    # "Unintended motion" is replaced by the user's harm, but not in texts of the user.
    kept = re.findall(r'"([^"]*nintended motion[^"]*)"', json.dumps(manifest.config))
    return html.with_scopes(events.name_harm(text, manifest.rules, map(escape, kept)))


@functools.cache
def _environment() -> jinja2.Environment:
    # Returns Jinja's environment, which also finds templates next to the sections' modules.
    environment = html.template_environment("ravenjax.report")
    section_templates = jinja2.PackageLoader("ravenjax.report", "sections")
    environment.loader = jinja2.ChoiceLoader([section_templates, environment.loader])  # pyright: ignore[reportArgumentType]
    environment.filters |= wording.FILTERS | {
        "as_json": json.dumps,
        "csv": downloads.format_csv,
        "hazard_titles": naming.titles_of,
    }
    return environment

"""Makes the HTML with which a notebook shows a campaign or its results."""

import functools
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import Group
from ravenjax.store.manifest import Manifest

if TYPE_CHECKING:
    from ravenjax.report.data.runs import Runs

MAX_GROUPS = 8
"""Number of groups that a card lists; further groups are only counted."""


def of_campaign(config: CampaignConfig) -> str:
    """Return the HTML card of a campaign: its robot, its operation and its groups."""
    return _render_card(
        "campaign.html.j2",
        config=config,
        facts=dict(config.lines()),
        faults=_describe_faults,
        counts=design.count_group_rows(config),
        runs=design.count_due_rows(config),
    )


def of_results(runs: "Runs", manifest: Manifest) -> str:
    """Return the HTML card of results: outcomes of all faults, and of each group."""
    from ravenjax.report import paper
    from ravenjax.report.sections import tables

    return _render_card(
        "results.html.j2",
        manifest=manifest,
        head=tables.headline_counts(runs, manifest),
        groups=[row for row in tables.group_rows(runs) if row["faulty"]],
        sampled=runs.sampled(),
        outcomes=paper.OUTCOMES,
    )


def _describe_faults(group: Group) -> str:
    # Returns the site and the effects of each fault, as "usb_out offset + encoder freeze".
    named = (
        f"{fault.site} {', '.join(dict.fromkeys(fault.effect.listed))}" for fault in group.fault
    )
    return " + ".join(dict.fromkeys(named)) or "none"


def _render_card(template: str, **content: Any) -> str:
    return _environment().get_template(template).render(most=MAX_GROUPS, **content)


@functools.cache
def _environment() -> jinja2.Environment:
    # Returns the Jinja templates of the HTML cards, with their style sheet.
    from ravenjax.document import html
    from ravenjax.report import wording

    templates = html.template_environment("ravenjax.notebook")
    templates.filters |= wording.FILTERS
    assert templates.loader is not None
    style, _, _ = templates.loader.get_source(templates, "card.css")
    templates.globals["style"] = Markup(style)
    return templates

"""Computes how much the results of the PSM campaign depend on fitted and assumed parameters. Prints
Markdown.

python analysis/psm/sensitivity.py
"""

import re
import tempfile
from pathlib import Path

import ravenjax as rj
from ravenjax.document.html import markdown_table

CAMPAIGN = Path(__file__).with_name("psm.toml")
MODEL = Path(__file__).parents[2] / "models/psm/psm.xml"
INERTIA = ("mass", "fullinertia", "diaginertia", "armature")
FRICTION = ("damping", "frictionloss", "stiffness")


def scaled(names: tuple[str, ...], factor: float) -> str:
    """Return the model with these attributes times a factor."""

    def times(match: re.Match[str]) -> str:
        numbers = " ".join(repr(float(word) * factor) for word in match[2].split())
        return f' {match[1]}="{numbers}"'

    return re.sub(rf' ({"|".join(names)})="([^"]*)"', times, MODEL.read_text())


def main() -> None:
    """Print how many faults evade, and how many verdicts differ from those of the campaign."""
    rows, usual = [], None
    with tempfile.TemporaryDirectory() as folder:
        changes = {"nothing": []}
        for what, text in {
            "all inertias halved": scaled(INERTIA, 0.5),
            "all inertias doubled": scaled(INERTIA, 2.0),
            "no friction, no springs": scaled(FRICTION, 0.0),
        }.items():
            file = Path(folder) / f"{what.replace(' ', '_').replace(',', '')}.xml"
            file.write_text(text)
            changes[what] = [f"campaign.robot={file}"]
        changes["gravity carried by the controller"] = ["parameters.gravity=1"]
        changes["less of the speed left after 1 ms of a stop, 0.9"] = ["parameters.coasting=0.9"]
        changes["a watchdog of 30 ms on set points"] = ["parameters.watchdog=30"]
        for seed in (1, 2, 3):
            changes[f"other set points, seed {seed}"] = [f"operator.seed={seed}"]
        for what, words in changes.items():
            words = [f"campaign.robot={MODEL}", *words]
            runs = rj.run(rj.Campaign.from_toml(str(CAMPAIGN), words))
            evades = (runs["response"] == "silent") & (runs["unintended_first_ms"] >= 0)
            verdicts = runs["verdict"].astype(str)
            usual = verdicts if usual is None else usual
            differ = str((verdicts != usual).sum())
            rows.append((what, str((evades & runs["activated"]).sum()), differ))
    print(markdown_table(("changed", "faults that evade", "verdicts that change"), rows))


if __name__ == "__main__":
    main()

"""What a counterfactual leaves: the table of candidates, the figure, and the set as a campaign
of its own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ravenjax.analyses.monitors import part_file
from ravenjax.analyses.monitors.counterfactual import figure, words
from ravenjax.analyses.monitors.counterfactual.finding import Counterfactual
from ravenjax.campaign import writing
from ravenjax.report import downloads
from ravenjax.store.files import require_writable, write_aside

TABLE, FIGURE, FOLDER, CAMPAIGN = (
    "counterfactual.csv",
    "counterfactual.svg",
    "chosen",
    "campaign.toml",
)


def write(one: Counterfactual, place: Path) -> list[Path]:
    """Write all of it; the paths. Raises StoreError where the disk refuses."""
    folder = place / FOLDER
    require_writable(folder)
    paths = [place / TABLE, place / FIGURE]
    _write(paths[0], downloads.text(words.table(one)))
    write_aside(paths[1], lambda target: figure.draw(one, target))
    for member, name in zip(one.promise.members, names(one), strict=True):
        part = one.parts[member]
        paths.append(folder / f"{name}.py")
        title = (
            f"{part.words[:1].upper()}{part.words[1:]}: 1 is the most that fault-free motion"
            " reached"
        )
        _write(paths[-1], part_file.text([part.score], title))
    paths.append(folder / CAMPAIGN)
    _write(paths[-1], campaign(one))
    return paths


def names(one: Counterfactual) -> list[str]:
    """Of the set's detectors, and of their files: the candidates', or such as no detector of the
    campaign has.
    """
    others, out = {own.name for own in one.config.detector}, []
    for member in one.promise.members:
        name, number = one.parts[member].name, 2
        while name in others:
            name, number = f"{one.parts[member].name}_{number}", number + 1
        others.add(name)
        out.append(name)
    return out


def campaign(one: Counterfactual) -> str:
    """The campaign with the set as detectors of its own, beside their files."""
    raw: dict[str, Any] = one.config.model_dump(mode="json", exclude_defaults=True)
    raw["campaign"]["name"] = f"{one.config.campaign.name[:90]}_watched"
    margin = one.promise.margin.value
    more = [
        {
            "name": name,
            "file": f"{name}.py",
            "consecutive": one.parts[member].consecutive,
            "threshold": [margin],
            "acts": "watch",
        }
        for member, name in zip(one.promise.members, names(one), strict=True)
    ]
    own, groups = raw.pop("detector", []), raw.pop("group")
    head = "".join(f"# {sentence}\n" for sentence in words.sentences(one))
    stop = (
        '# acts = "stop" lets a check press the E-stop. Other faults of the same kinds: --set'
        " campaign.seed=N\n"
    )
    return f"{head}{stop}\n" + writing.text({**raw, "detector": [*own, *more], "group": groups})


def _write(path: Path, text: str) -> None:
    write_aside(path, lambda target: target.write_text(text, encoding="utf-8"))

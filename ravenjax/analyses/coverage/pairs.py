"""Finds pairs of faults that harm together although neither fault harms alone, and the reverse.

The campaign has runs with two faults, and runs with each of these faults alone. A minimal *cut set*
is a set of faults that harm together, while no smaller subset harms. A cut set of order 1 is a
single harmful fault, a cut set of order 2 is a pair. Faults can also cancel: a pair may be harmless
although one of its faults harms alone. A fault tree cannot represent such a pair.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.document import html
from ravenjax.errors import UserError
from ravenjax.report import downloads, wording
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections.coverage import list_sources, times_sql
from ravenjax.store.access.query import RESULTS, quote_name
from ravenjax.store.files import write_text
from ravenjax.vocabulary.effects import FIELDS

PACKAGE = "ravenjax.analyses.coverage"
TABLE, DRAWING, MODEL = "pairs.csv", "fault_tree.svg", "fault_tree.xml"

USUAL = "every_cycle"
"""Setting of campaign.packets without random durations of packets."""


class Single(NamedTuple):
    """A run with one fault."""

    run: str
    site: str
    fault: str  # description of the fault
    harms: bool
    detected_by: Sequence[str]  # sources that report by themselves


class Pair(NamedTuple):
    """A run with two faults that both changed a bit, and the two runs with one of these faults."""

    run: str
    first: Single
    second: Single
    harms: bool
    response: str  # of the checks, a word of the verdict
    kind: str  # "cut set", "masked", or "" if the pair harms as its faults alone do
    defeated: Sequence[str]  # sources that detect one of the faults alone, but not the pair

    def cells(self) -> dict[str, Any]:
        """Return the row of the pair in the table."""
        sides = (("first", self.first), ("second", self.second))
        alone = {
            f"{side}_{key}": value
            for side, one in sides
            for key, value in (("run", one.run), ("fault", one.fault), ("harms", one.harms))
        }
        own = {"pair_harms": self.harms, "response": self.response, "kind": self.kind}
        return {"run": self.run, **alone, **own, "defeated": ", ".join(self.defeated)}


class DoubleFaults(NamedTuple):
    """The single faults and the pairs of a campaign."""

    singles: Sequence[Single]
    pairs: Sequence[Pair]
    notices: Sequence[str]
    limit_mm: float

    @property
    def counts(self) -> dict[str, int]:
        """The number of faults and pairs of each kind, by the description of the kind."""
        kinds = Counter(pair.kind for pair in self.pairs)
        defeating = [pair for pair in self.pairs if pair.defeated]
        return {
            "single faults": len(self.singles),
            "single faults that harm: cut sets of order 1": len(self.cut_sets()[0]),
            "pairs in which both faults act": len(self.pairs),
            "pairs that harm": sum(pair.harms for pair in self.pairs),
            "pairs that harm although neither fault harms alone: cut sets of order 2": kinds[
                "cut set"
            ],
            "pairs that do not harm although a fault harms alone: masked": kinds["masked"],
            "pairs that hide a fault from a check": len(defeating),
            "pairs that hide a fault from a check and harm": sum(pair.harms for pair in defeating),
        }

    def cut_sets(self) -> tuple[list[Single], list[Pair]]:
        """Return the minimal cut sets of order 1 and 2."""
        pairs = [pair for pair in self.pairs if pair.kind == "cut set"]
        return [one for one in self.singles if one.harms], pairs


def measure_pairs(runs: Runs) -> DoubleFaults:
    """Compare each run with two faults with the runs that have one of them.

    Runs belong together if their faults, operator and varied parameters agree. Raises UserError if
    no run has two faults.
    """
    sources = list_sources(runs)
    reporting = [one.name for one in sources if one.reports]
    slots = range(runs.manifest.shape.slots)
    keys = ", ".join(
        f"CASE WHEN fault{n}_site <> '' THEN {_hash(runs, [f'fault{n}_{key}' for key in FIELDS])}"
        " END"
        for n in slots
    )
    keys = keys or "NULL"
    acting = " + ".join(["0", *(f"(applied{n}_ticks > 0)::INTEGER" for n in slots)])
    setting = ["operator", *(name for name in runs.names if name.startswith("param:"))]
    frame = runs.table.frame(
        f"SELECT row, run_id, site::VARCHAR AS site, unintended,"
        f" {FACTS}.response::VARCHAR AS response, {acting} AS acting,"
        f" concat_ws(' ', {keys}) AS faults,"
        f" {_hash(runs, setting)} AS setting{times_sql(sources)} FROM {RESULTS} JOIN {FACTS}"
        f" USING (row) WHERE plain AND faulty AND NOT {FACTS}.failed ORDER BY row"
    )
    frame["faults"] = frame["faults"].str.split()
    frame["together"] = frame["faults"].map(len)
    frame["detected_by"] = [
        [name for name, ms in zip(reporting, row, strict=True) if ms >= 0]
        for row in frame[reporting].to_numpy()
    ]
    frame["words"] = [
        wording.describe_fault(row, runs.robot) for row in runs.whole_rows(frame["row"].tolist())
    ]
    alone: dict[tuple[str, str], Single] = {}
    singles, doubles = (frame.loc[frame["together"] == n].to_dict("records") for n in (1, 2))
    for row in singles:
        single = Single(
            row["run_id"], row["site"], row["words"], row["unintended"], row["detected_by"]
        )
        alone.setdefault((row["faults"][0], row["setting"]), single)
    if not doubles:
        raise UserError(
            "no run has two faults: write two [[group.fault]] in a group, as in campaigns/"
            "double_faults.toml"
        )
    pairs, unmatched, idle = [], 0, 0
    for row in doubles:
        first, second = (alone.get((key, row["setting"])) for key in row["faults"])
        if first is None or second is None:
            unmatched += 1
        elif row["acting"] < 2:
            idle += 1
        else:
            pairs.append(_pair(row, first, second))
    settings = runs.manifest.config.get("campaign") or {}
    content = {
        "idle": idle,
        "unmatched": unmatched,
        "repeated": len(singles) - len(alone),
        "more": len(frame) - len(singles) - len(doubles),
        "random": settings.get("noise") or settings.get("packets", USUAL) != USUAL,
    }
    template = wording.text_templates(PACKAGE).get_template("pairs.txt.j2")
    return DoubleFaults(
        list(alone.values()), pairs, template.render(content).splitlines(), runs.manifest.limit_mm
    )


def write_pairs(found: DoubleFaults, out_folder: Path) -> list[Path]:
    """Write the table of pairs, and the cut sets as a drawn fault tree and in the Open-PSA format.

    Return the paths. Raise StoreError if a file cannot be written.
    """
    singles, pairs = found.cut_sets()
    by_site: dict[str, list[Single | Pair]] = {}
    for one in singles:
        by_site.setdefault(one.site, []).append(one)
    for pair in pairs:
        by_site.setdefault(f"{pair.first.site} and {pair.second.site}", []).append(pair)
    templates = html.template_environment(PACKAGE)
    texts = {
        name: templates.get_template(f"{name}.j2").render(found=found, branches=by_site)
        for name in (DRAWING, MODEL)
    }
    texts[TABLE] = downloads.format_csv(pair.cells() for pair in found.pairs)
    for name, text in texts.items():
        write_text(out_folder / name, text)
    return [out_folder / name for name in texts]


def _pair(row: dict[str, Any], first: Single, second: Single) -> Pair:
    harms, alone = row["unintended"], first.harms or second.harms
    kind = "" if harms == alone else "cut set" if harms else "masked"
    defeated = {*first.detected_by, *second.detected_by}.difference(row["detected_by"])
    return Pair(row["run_id"], first, second, harms, row["response"], kind, sorted(defeated))


def _hash(runs: Runs, names: Sequence[str]) -> str:
    """Return SQL for a text that is equal for equal values of these columns."""
    # Adding 0 turns a negative zero into a positive one.
    terms = (
        f"0 + {quote_name(name)}" if runs.types[name] in ("FLOAT", "DOUBLE") else quote_name(name)
        for name in names
    )
    return f"hash({', '.join(terms)})::VARCHAR"

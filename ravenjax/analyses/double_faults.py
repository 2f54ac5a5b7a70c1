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

PACKAGE = "ravenjax.analyses"
TABLE, DRAWING, MODEL = "pairs.csv", "fault_tree.svg", "fault_tree.xml"

FIXED_PACKETS = "every_cycle"
"""Setting of campaign.packets without random durations of packets."""


class Single(NamedTuple):
    """A run with one fault."""

    run: str
    site: str
    fault: str  # description of the fault
    harms: bool
    detected_by: Sequence[str]  # checks and detectors that raised an alarm or stopped the robot


class Pair(NamedTuple):
    """A run with two faults that both changed a bit, and the two runs with one of these faults."""

    run: str
    first: Single
    second: Single
    harms: bool
    response: str  # of the checks, a word of the verdict
    kind: str  # "cut set", "masked", or "" if the pair harms as its faults alone do
    defeated: Sequence[str]  # checks and detectors that detect one of the faults, but not the pair

    def cells(self) -> dict[str, Any]:
        """Return the row of the pair in the table."""
        return {
            "run": self.run,
            "first_run": self.first.run,
            "first_fault": self.first.fault,
            "first_harms": self.first.harms,
            "second_run": self.second.run,
            "second_fault": self.second.fault,
            "second_harms": self.second.harms,
            "pair_harms": self.harms,
            "response": self.response,
            "kind": self.kind,
            "defeated": ", ".join(self.defeated),
        }


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
        return [single for single in self.singles if single.harms], pairs


def measure_pairs(runs: Runs) -> DoubleFaults:
    """Compare each run with two faults with the two runs that have only one of these faults.

    Runs belong together if their faults, operator and varied parameters agree. Raises UserError if
    no run has two faults.
    """
    # Checks, detectors and cues. A cue does not report by itself.
    sources = list_sources(runs)
    reporting = [source.name for source in sources if source.reports]
    slots = range(runs.manifest.shape.slots)
    # SQL for a text that identifies each fault of a run, and NULL for an empty slot.
    keys = []
    for n in slots:
        fault_hash = _hash_sql(runs, [f"fault{n}_{field}" for field in FIELDS])
        keys.append(f"CASE WHEN fault{n}_site <> '' THEN {fault_hash} END")
    acting = " + ".join(["0", *(f"(applied{n}_ticks > 0)::INTEGER" for n in slots)])
    setting = ["operator", *(name for name in runs.names if name.startswith("param:"))]
    frame = runs.table.frame(
        f"SELECT row, run_id, site::VARCHAR AS site, unintended,"
        f" {FACTS}.response::VARCHAR AS response, {acting} AS acting,"
        f" concat_ws(' ', {', '.join(keys) or 'NULL'}) AS faults,"
        f" {_hash_sql(runs, setting)} AS setting{times_sql(sources)} FROM {RESULTS} JOIN {FACTS}"
        f" USING (row) WHERE plain AND faulty AND NOT {FACTS}.failed ORDER BY row"
    )
    frame["faults"] = frame["faults"].str.split()
    frame["fault_count"] = frame["faults"].map(len)
    # A source with the time -1 did not detect the fault.
    frame["detected_by"] = [
        [name for name, ms in zip(reporting, row, strict=True) if ms >= 0]
        for row in frame[reporting].to_numpy()
    ]
    frame["words"] = [
        wording.describe_fault(row, runs.robot) for row in runs.whole_rows(frame["row"].tolist())
    ]
    # The single faults by identity and setting. Of repeated runs, the first counts.
    singles: dict[tuple[str, str], Single] = {}
    single_rows = frame.loc[frame["fault_count"] == 1].to_dict("records")
    double_rows = frame.loc[frame["fault_count"] == 2].to_dict("records")
    for row in single_rows:
        single = Single(
            row["run_id"], row["site"], row["words"], row["unintended"], row["detected_by"]
        )
        singles.setdefault((row["faults"][0], row["setting"]), single)
    if not double_rows:
        raise UserError(
            "no run has two faults: write two [[group.fault]] in a group, as in campaigns/"
            "double_faults.toml"
        )
    pairs, unmatched, idle = [], 0, 0
    for row in double_rows:
        first, second = (singles.get((key, row["setting"])) for key in row["faults"])
        if first is None or second is None:
            unmatched += 1
        elif row["acting"] < 2:
            idle += 1
        else:
            pairs.append(_compare_pair(row, first, second))
    settings = runs.manifest.config.get("campaign") or {}
    content = {
        "idle": idle,
        "unmatched": unmatched,
        "repeated": len(single_rows) - len(singles),
        "more": len(frame) - len(single_rows) - len(double_rows),
        "random": settings.get("noise") or settings.get("packets", FIXED_PACKETS) != FIXED_PACKETS,
    }
    template = wording.text_templates(PACKAGE).get_template("pairs.txt.j2")
    notices = template.render(content).splitlines()
    return DoubleFaults(list(singles.values()), pairs, notices, runs.manifest.limit_mm)


def write_pairs(found: DoubleFaults, out_folder: Path) -> list[Path]:
    """Write the table of pairs, and the cut sets as a drawn fault tree and in the Open-PSA format.

    Return the paths. Raise StoreError if a file cannot be written.
    """
    singles, pairs = found.cut_sets()
    # A branch of the tree has the cut sets of one site, or of two.
    branches: dict[str, list[Single | Pair]] = {}
    for single in singles:
        branches.setdefault(single.site, []).append(single)
    for pair in pairs:
        branches.setdefault(f"{pair.first.site} and {pair.second.site}", []).append(pair)
    templates = html.template_environment(PACKAGE)
    texts = {
        name: templates.get_template(f"{name}.j2").render(found=found, branches=branches)
        for name in (DRAWING, MODEL)
    }
    texts[TABLE] = downloads.format_csv(pair.cells() for pair in found.pairs)
    for name, text in texts.items():
        write_text(out_folder / name, text)
    return [out_folder / name for name in texts]


def _compare_pair(row: dict[str, Any], first: Single, second: Single) -> Pair:
    # Compares the run of a pair, a row of the result table, with the runs of its faults.
    harms, fault_harms = row["unintended"], first.harms or second.harms
    kind = ""
    if harms != fault_harms:
        kind = "cut set" if harms else "masked"
    defeated = {*first.detected_by, *second.detected_by}.difference(row["detected_by"])
    return Pair(row["run_id"], first, second, harms, row["response"], kind, sorted(defeated))


def _hash_sql(runs: Runs, names: Sequence[str]) -> str:
    """Return an SQL expression for a text that is equal for equal values of these columns."""
    terms = []
    for name in names:
        # Adding 0 turns a negative zero into a positive one.
        prefix = "0 + " if runs.types[name] in ("FLOAT", "DOUBLE") else ""
        terms.append(f"{prefix}{quote_name(name)}")
    return f"hash({', '.join(terms)})::VARCHAR"

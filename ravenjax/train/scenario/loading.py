"""Reads a scenario file and checks its tables, its overrides and its hazards.

All errors are reported at once, each with file, line, key, the value found and the value expected.
"""

from collections.abc import Sequence
from pathlib import Path

from ravenjax import resources
from ravenjax.campaign.file import location, overriding
from ravenjax.campaign.file.section import parse
from ravenjax.campaign.inspection.json_schema import of_model
from ravenjax.train.robot import ROBOT
from ravenjax.train.scenario.campaign import Tables, find_scenario_errors
from ravenjax.train.scenario.config import Scenario

FOLDER = "campaigns/training"  # Folder of the bundled scenarios


def load_scenario(name: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Return the scenario in a file, or a bundled scenario by name. overrides: `key.path=value`, in
    place of values of the file. Raises UserError as `from_dict`.
    """
    file = location.find_campaign_file(name, FOLDER, "scenario")
    raw, text = location.read_toml(file)
    return from_dict(raw, source=file, text=text, overrides=overrides)


def bundled_scenarios() -> list[Path]:
    """Return the paths of the bundled scenario files."""
    return resources.list_resources(FOLDER, f"*{location.SUFFIX}")


def from_dict(
    raw: Tables, source: Path | None = None, text: str = "", overrides: Sequence[str] = ()
) -> Scenario:
    """Return the scenario that TOML tables declare. Raises UserError with file, line and key."""
    raw, replaced = overriding.apply_overrides(raw, overrides)
    where = location.Where(source, location.key_lines(text), replaced)
    scenario, mistakes = parse(Scenario, raw)
    if scenario is None:
        raise where.error(mistakes)
    if mistakes := list(find_scenario_errors(scenario)):
        raise where.error(mistakes)
    return scenario


def json_schema() -> Tables:
    """Return the JSON Schema of a scenario file."""
    schema = of_model(ROBOT, Scenario)
    fault, entry = schema["$defs"]["Fault"], schema["$defs"]["Entry"]
    # A fault is active from its hazard's start, so it needs no start_ms.
    fault["required"].remove("start_ms")
    # An entry has either hazards of the library or faults of its own.
    entry["oneOf"] = [{"required": ["hazards"]}, {"required": ["fault"]}]
    return schema

"""Reads a scenario file and checks its tables, its overrides and its hazards.

All errors are reported at once, each with file, line, key, the value found and the value expected.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import BaseModel, ValidationError

from ravenjax import resources
from ravenjax.campaign.file import location, overriding
from ravenjax.campaign.inspection.json_schema import of_model
from ravenjax.errors import UserError, format_error, format_value, model_at, suggest_name
from ravenjax.train.robot import ROBOT
from ravenjax.train.scenario.campaign import Tables, find_scenario_errors
from ravenjax.train.scenario.config import TASKS, Scenario

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
    try:
        scenario = Scenario.model_validate(raw)
    except ValidationError as error:
        # If all entries of a list are invalid, pydantic also reports that the list is too short.
        errors = [
            each for each in error.errors() if each["type"] != "too_short" or not each["input"]
        ]
        raise where.error((_key(each["loc"], raw), _message(each)) for each in errors) from None
    except RecursionError:
        raise UserError("the scenario's tables are nested too deeply to be read") from None
    if errors := list(find_scenario_errors(scenario)):
        raise where.error(errors)
    return scenario


def json_schema() -> Tables:
    """Return the JSON Schema of a scenario file."""
    schema = of_model(ROBOT, Scenario)
    fault, entry = schema["$defs"]["Fault"], schema["$defs"]["Entry"]
    # A fault is active from its hazard's start, so it needs no start_ms.
    fault["required"].remove("start_ms")
    entry["oneOf"] = [{"required": ["hazards"]}, {"required": ["fault"]}]
    return schema


def _key(loc: tuple[str | int, ...], raw) -> location.Key:
    """Return the key in the file for pydantic's `loc`, which also names members of unions."""
    key: location.Key = ()
    for i, part in enumerate(loc):
        # The last part may be a missing key. Any other part that is no key is a union's member.
        is_last = i == len(loc) - 1
        if isinstance(raw, Mapping) and (part in raw or is_last):
            key, raw = (*key, part), raw.get(part)
        elif isinstance(raw, list | tuple) and isinstance(part, int):
            key, raw = (*key, part), raw[part] if part < len(raw) else None
    return key


def _message(error) -> str:
    # Returns the message of one of pydantic's errors, with the nearest valid name, if there is one.
    got, suggestion = error["input"], ""
    match error["type"]:
        case "union_tag_not_found":
            return f"kind is missing, expected kind = one of {', '.join(TASKS)}"
        case "union_tag_invalid":
            task = got.get("kind")
            expected = f"expected kind = one of {', '.join(TASKS)}{suggest_name(task, TASKS)}"
            return f"got {format_value(task)}, {expected}"
        case "literal_error":
            # The text of the expected names is like: 'a', 'b' or 'c'.
            suggestion = suggest_name(got, error["ctx"]["expected"].split("'")[1::2])
    return format_error(error, _model(error["loc"][:-1])) + suggestion


def _model(loc: Sequence[str | int]) -> type[BaseModel]:
    task = next((TASKS[str(part)] for part in loc[1:2] if part in TASKS), Scenario)
    return model_at(task, loc)

"""Reads and checks a campaign file, and applies overrides from the command line.

Reading is fast: it compiles nothing and does not import the simulation. One error reports all
mistakes, each with the file, the line, the key, the value and the expected values.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from ravenjax import consent, robots
from ravenjax.campaign import population
from ravenjax.campaign.faults import design
from ravenjax.campaign.file import location, overriding, semantics
from ravenjax.campaign.file.config import CampaignConfig, config_class_of, robot_of
from ravenjax.errors import UserError, format_error, format_value, model_at, models_in, suggest_name
from ravenjax.hazards import expansion
from ravenjax.store import manifest


def load_campaign(
    campaign: str | Path | dict[str, Any], overrides: Sequence[str] = (), runs: bool = True
) -> CampaignConfig:
    """Read and check a campaign: a TOML file, the name of a bundled campaign, or nested tables.

    The ending `.toml` may be left out. overrides: `key.path=value`, as for `--set` on the command
    line. Paths in a campaign file are relative to its folder. runs: if True, and `campaign` is a
    path, Python files in the folder of the campaign file may run without a question
    (docs/how-to/files-of-others.md). Raise UserError with all mistakes and their lines.
    """
    if isinstance(campaign, dict):
        return from_dict(campaign, overrides=overrides)
    file = location.find_campaign_file(campaign, "campaigns", "campaign", "ravenjax campaigns")
    raw, text = location.read_toml(file)
    # A name without a path may mean a file in ./campaigns, which somebody else may have written.
    is_named_by_path = file.parent.resolve() == Path(campaign).parent.resolve()
    trusted_folders = [file.parent] if runs and is_named_by_path else []
    with consent.trust_folders(*trusted_folders):
        return from_record(raw, overrides, file, text)


def load_source(source: str | Path, overrides: Sequence[str] = ()) -> CampaignConfig:
    """Return the campaign of a file, of a bundled name, or of a result folder. A result folder
    permits no overrides. Raise UserError and StoreError.
    """
    if not result_folder(source):
        return load_campaign(source, overrides)
    if overrides:
        raise UserError(
            f"--set can change only a campaign file, but {source} is a result folder: name the"
            " campaign file"
        )
    folder = Path(source)
    return validate_tables(manifest.read_manifest(folder).config, folder / manifest.FILE)


def result_folder(source: Any) -> bool:
    """Return whether `source` is the path of a result folder."""
    return isinstance(source, str | Path) and (Path(source) / manifest.FILE).is_file()


def from_dict(
    raw: dict[str, Any], source: Path | None = None, text: str = "", overrides: Sequence[str] = ()
) -> CampaignConfig:
    """Return the campaign of nested tables as in a TOML file, with overrides applied. `source` and
    `text` are the file and its text, for error messages. Python code in the folder of the file may
    run. Without a file, a program wrote the tables, and any code may run. Raise UserError.
    """
    with consent.trust_folders(consent.EVERYWHERE if source is None else source.parent):
        return from_record(raw, overrides, source, text)


def from_record(
    raw: dict[str, Any], overrides: Sequence[str], source: Path | None = None, text: str = ""
) -> CampaignConfig:
    """Return the campaign of tables that somebody else may have written. Python code that the
    tables name runs only if the user has agreed to it (see `consent`).
    """
    raw, replaced = overriding.apply_overrides(raw, overrides)
    where = location.Where(source, location.key_lines(text), replaced)
    raw = population.add_parameter_file(raw, where, source)
    try:
        robot = robot_of(raw, source and source.parent)
    except UserError as error:
        raise where.error([(("campaign", "robot"), str(error))]) from None
    try:
        # If `raw` is no table, the check of the whole file below refuses it.
        if isinstance(raw, dict):
            groups = raw.get("group", ())
            # A group with a list of hazards becomes one group for each of their cases. Messages
            # name the groups of the file, so number_in_file has the number of each group's origin.
            raw, where.number_in_file = expansion.expand_tables(raw, robot)
            if where.number_in_file:
                where.groups = groups
                where.names = [str(group.get("name")) for group in raw["group"]]
    except expansion.WrongGroup as error:
        raise where.error([(error.key, error.message)]) from None
    if robot.name.endswith(robots.MJCF):
        raw = raw | {"campaign": raw["campaign"] | {"robot": robot.name}}
    config = _validate(config_class_of(robot), raw, where).with_files(
        Path.cwd() if source is None else source.parent
    )
    config._source = source
    # Hazards that a group lists twice, for a notice.
    repeated = []
    for number, group in enumerate(where.groups):
        hazards = group.get("hazards")
        if isinstance(hazards, list):
            repeated += [(number, id_) for id_ in dict.fromkeys(hazards) if hazards.count(id_) > 1]
    config._repeated = tuple(repeated)
    return _check_meaning(config, where)


def validate_tables(raw: Any, source: Path | None = None) -> CampaignConfig:
    """Return the campaign of complete tables, as in a manifest. source: file, for UserError."""
    where = location.Where(source, {}, [])
    return _check_meaning(_validate(config_class_of(robot_of(raw)), raw, where), where)


def _validate(model: type[CampaignConfig], raw, where: location.Where) -> CampaignConfig:
    # Returns the campaign of the tables `raw`. Raises UserError for wrong keys and values.
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        # If all entries of a list are invalid, Pydantic also reports the list as too short.
        mistakes = [e for e in error.errors() if e["type"] != "too_short" or not e["input"]]
        raise where.error(
            _describe_mistake(model, mistake, raw)
            for mistake in mistakes
            if not _is_explained_by_misspelling(mistake, mistakes)
        ) from None
    except RecursionError:
        raise UserError("the campaign's tables are nested too deeply to be read") from None


def _check_meaning(config: CampaignConfig, where: location.Where) -> CampaignConfig:
    """Return `config` unchanged. Raise UserError for mistakes that involve several keys."""
    errors = list(semantics.find_errors(config))
    if not errors and (runs := design.count_rows(config)) > design.MOST_RUNS:
        expected = f"expected at most {design.MOST_RUNS}"
        errors = [(("group",), f"the groups make {format_value(runs)} runs, {expected}")]
    if errors:
        raise where.error(errors)
    return config


def _is_explained_by_misspelling(missing, errors: Sequence[Any]) -> bool:
    # Returns whether an error is about a missing key that another error reports as misspelt. This
    # is so if an unknown key of the same table is similar to the missing key.
    *table, key = missing["loc"] or ("",)
    return missing["type"] == "missing" and any(
        suggest_name(other["loc"][-1], (key,))
        for other in errors
        if other["type"] == "extra_forbidden" and list(other["loc"][:-1]) == table
    )


def check_parameters(config: CampaignConfig, known: Iterable[str] | None = None) -> None:
    """Raise UserError for a parameter whose values are outside its range. If `known` is given,
    raise UserError instead for a parameter that is not in these paths.
    """
    # This import needs the robot's tick, which is slow to import.
    from ravenjax.campaign.file import bounds

    if known is None:
        errors = list(bounds.find_invalid_values(config))
    else:
        errors = list(bounds.find_invalid_paths(config, known))
    if errors:
        source = config.source
        text = source.read_text(encoding="utf-8") if source is not None and source.is_file() else ""
        raise location.Where(source, location.key_lines(text), []).error(errors)


def _describe_mistake(model: type[CampaignConfig], error, raw) -> location.Complaint:
    # Returns the key to which an error of pydantic belongs, and ravenjax's message. A validator of
    # a whole table may write "key: message". This key is then added, unless it is the last part.
    key, message = _key_in_file(error["loc"], raw), _message(model, error)
    name, colon, rest = message.partition(": ")
    if (
        error["type"] == "value_error"
        and colon
        and name in model_at(model, error["loc"]).model_fields
        and name not in key[-1:]
    ):
        return (*key, name), rest
    return key, message


def _key_in_file(loc: tuple[str | int, ...], raw) -> location.Key:
    # Shortens pydantic's location of an error, which may end in names of types, to the file's keys.
    key: location.Key = ()
    for part in loc:
        if isinstance(raw, dict):
            raw = raw.get(part)
        elif isinstance(raw, list | tuple) and isinstance(part, int):
            raw = raw[part] if part < len(raw) else None
        else:
            break
        key = (*key, part)
    return key


def _message(model: type[CampaignConfig], error) -> str:
    # Returns the message of an error. If a key is in the wrong table, it names the right table.
    if error["type"] == "tuple_type":
        path = tuple(part for part in error["loc"] if isinstance(part, str))
        if isinstance(error["input"], dict) and path in dict(tables_of(model)):
            return (
                f"got one table, expected a list of tables: begin each table with"
                f" [[{'.'.join(path)}]], in double brackets"
            )
        return f"got {format_value(error['input'])}, expected a list"
    table, hint = model_at(model, error["loc"][:-1]), ""
    name = error["loc"][-1] if error["loc"] else ""
    if error["type"] == "extra_forbidden" and not suggest_name(name, table.model_fields):
        headers = [
            table_header(path)
            for path, other_table in tables_of(model)
            if path and name in other_table.model_fields
        ]
        hint = f". It is a key of {' and '.join(headers)}" if headers else ""
    return format_error(error, table, hint)


def tables_of(
    model: type[BaseModel], path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], type[BaseModel]]]:
    """Yield (path, model) of every table of a file, in order. The whole file is the first: ()."""
    yield path, model

    def file_order(name: str) -> int:
        # In a file, [campaign] comes first, then the tables that only this robot has.
        if name == "campaign":
            return 0
        return 1 if not path and name not in CampaignConfig.model_fields else 2

    for name in sorted(model.model_fields, key=file_order):
        for inner in models_in(model.model_fields[name].annotation):
            yield from tables_of(inner, (*path, name))


def table_header(path: tuple[str, ...]) -> str:
    """Return the header of a table in a file, such as `[campaign]` or `[[group.fault]]`."""
    name = ".".join(path)
    return f"[[{name}]]" if path[0] in ARRAYS else f"[{name}]"


ARRAYS = ("group", "detector", "check")
"""Tables of which a file may have several."""

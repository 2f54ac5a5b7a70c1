"""Reads and checks a campaign file, and applies overrides from the command line.

Reading is fast: it compiles nothing and does not import the simulation. One error reports all
mistakes, each with the file, the line, the key, the value and the expected values.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ravenjax import consent, robots
from ravenjax.campaign import population
from ravenjax.campaign.faults import design
from ravenjax.campaign.file import location, overriding, semantics
from ravenjax.campaign.file.config import CampaignConfig, config_class_of, robot_of
from ravenjax.campaign.file.section import parse
from ravenjax.errors import UserError, format_value, is_table
from ravenjax.hazards import expansion
from ravenjax.store import manifest
from ravenjax.vocabulary.robot import Robot


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
        if is_table(raw):
            groups = raw.get("group", ())
            # A group with a list of hazards becomes one group for each of their cases. Messages
            # name the groups of the file, so number_in_file has the number of each group's origin.
            raw, where.number_in_file = expansion.expand_tables(raw, robot)
            if where.number_in_file:
                where.groups = groups
                names = [group.get("name") for group in raw["group"]]
                where.names = [name if isinstance(name, str) else "" for name in names]
    except expansion.WrongGroup as error:
        raise where.error([(error.key, error.message)]) from None
    # The name of a robot from an MJCF file becomes the absolute path of this file.
    if robot.name.endswith(robots.MJCF):
        raw = raw | {"campaign": raw["campaign"] | {"robot": robot.name}}
    return _validate(robot, raw, where, Path.cwd() if source is None else source.parent)


def validate_tables(raw: Any, source: Path | None = None) -> CampaignConfig:
    """Return the campaign of complete tables, as in a manifest. source: file, for UserError."""
    return _validate(robot_of(raw), raw, location.Where(source, {}, []))


def _validate(
    robot: Robot, raw: Any, where: location.Where, folder: Path | None = None
) -> CampaignConfig:
    # Returns the campaign of the tables `raw`. folder: of its Python files; None: their paths are
    # absolute. Raises UserError for wrong keys and values, then for mistakes of several keys.
    config, mistakes = parse(config_class_of(robot), raw)
    if config is None:
        raise where.error(mistakes)
    if folder is not None:
        config = config.with_files(folder)
    config.keep_places(where, is_being_read=True)
    mistakes += semantics.find_errors(config)
    if not mistakes and (runs := design.count_rows(config)) > design.MOST_RUNS:
        expected = f"expected at most {design.MOST_RUNS}"
        mistakes = [(("group",), f"the groups make {format_value(runs)} runs, {expected}")]
    if mistakes:
        raise where.error(mistakes)
    config.keep_places(where, is_being_read=False)
    return config


def check_parameters(config: CampaignConfig, known: Iterable[str] | None = None) -> None:
    """Raise UserError for a parameter whose values are outside its range, or that a fault cannot
    change. known: None, or paths; then check only that each parameter is one of these paths.
    """
    # This import needs the robot's tick, which is slow to import.
    from ravenjax.campaign.file import bounds

    if known is None:
        errors = list(bounds.find_invalid_values(config))
        # The ranges of the parameters were unknown when the values of these faults were checked.
        errors += semantics.find_errors(config) if any(config.faulty_parameters()) else ()
    else:
        errors = list(bounds.find_invalid_paths(config, known))
    if errors:
        raise config.where.error(errors)

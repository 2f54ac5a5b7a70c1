"""Reads a file with parameters of a calibrated robot: `[parameters] from = "my_robot.toml"`.

The file has a table [parameters], and a table [campaign] with the settings for which its numbers
are valid. If the campaign also sets a parameter, the campaign's value is used.
"""

from pathlib import Path
from typing import Any, NoReturn

from ravenjax.campaign.file.group import flatten_table
from ravenjax.campaign.file.location import Where, read_toml
from ravenjax.errors import UserError, format_value

KEY = "from"
TABLES = ("campaign", "parameters")


def add_parameter_file(raw: dict[str, Any], where: Where, source: Path | None) -> dict[str, Any]:
    """Return the tables `raw` of a campaign, completed with the tables of its file of parameters.
    The key `from` in [parameters] names the file, relative to the folder of the campaign file
    `source`. Without this key return `raw`. Raise UserError for a file that cannot be used.
    """
    parameters = raw.get("parameters") if isinstance(raw, dict) else None
    if not isinstance(parameters, dict) or KEY not in parameters:
        return raw

    def refuse(message: str, *key: str) -> NoReturn:
        raise where.error([(key or ("parameters", KEY), message)]) from None

    if not isinstance(parameters[KEY], str):
        refuse(
            f"got {format_value(parameters[KEY])}, expected the path of a file that"
            " `ravenjax calibrate` wrote"
        )
    path = Path(parameters[KEY]) if source is None else source.parent / parameters[KEY]
    if not path.is_file():
        refuse(f"found no file {path}; `ravenjax calibrate LOG` writes such a file")
    try:
        content, _ = read_toml(path)
    except UserError as error:
        refuse(str(error))
    if unknown := [name for name in content if name not in TABLES]:
        refuse(f"{path} has {', '.join(unknown)}, expected only [campaign] and [parameters]")
    campaign = raw.get("campaign", {})
    # The parameters are valid only for these settings of [campaign].
    for name, value in content.get("campaign", {}).items():
        if campaign.get(name, value) != value:
            refuse(
                f"got {format_value(campaign[name])}, but the parameters in {path} are valid for"
                f" {format_value(value)}: remove one of the two",
                "campaign",
                name,
            )
    set_here = {name: value for name, value in parameters.items() if name != KEY}
    return {
        **raw,
        "campaign": {**content.get("campaign", {}), **campaign},
        "parameters": {**flatten_table(content.get("parameters", {})), **flatten_table(set_here)},
    }

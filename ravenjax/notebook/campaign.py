"""The class Campaign: declared in Python or read from a TOML file, then checked and run."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from ravenjax import robots
from ravenjax.campaign import loading, population, writing
from ravenjax.campaign.executors import choose_executor
from ravenjax.campaign.file import location, overriding
from ravenjax.campaign.file.config import CampaignConfig, config_class_of, robot_of
from ravenjax.campaign.file.section import toml_value
from ravenjax.campaign.progress import OnProgress
from ravenjax.campaign.stop import adaptive
from ravenjax.errors import UserError, format_value, is_table, models_in, tables_of
from ravenjax.store import files
from ravenjax.store.folder import Results

if TYPE_CHECKING:
    from ravenjax.notebook.results import CampaignResults

SECTION = "campaign"
"""The table with the general keys of a campaign."""


class Campaign:
    """A campaign. Arguments are the keys of [campaign], and other tables as objects or dicts.

        campaign = rj.Campaign(
            name="mine",
            duration_s=1.0,
            group=[
                rj.Group(
                    name="dac",
                    design="random",
                    runs=100,
                    fault=[
                        rj.Fault(
                            site="usb_out",
                            channel=["shoulder", "elbow"],
                            effect="offset",
                            value=rj.uniform(-5000, 5000),
                            start_ms=[500, 700],
                        )
                    ],
                )
            ],
        )
        results = campaign.run()

    The keys and rules are those of a campaign file. The constructor raises UserError, which names
    each wrong key, its value and the allowed values. Two campaigns with the same content are equal.
    A campaign is immutable; `replace` returns a copy with other values. Paths of files are relative
    to the working directory.
    """

    config: CampaignConfig
    """The checked campaign with all defaults, and with the library's hazards as ordinary groups."""
    _tables: dict[str, Any]

    def __init__(self, **keys: Any) -> None:
        tables = _tables_of(keys)
        self._set_content(tables, Path.cwd(), loading.from_dict(tables))

    def _set_content(self, tables: dict[str, Any], folder: Path, config: CampaignConfig) -> None:
        # Fills a new object. Paths in `tables` are relative to `folder`.
        loading.check_parameters(config)
        tables = _change_file_paths(tables, lambda file: str((folder / file).absolute()))
        self.__dict__.update(_tables=tables, config=config)

    @classmethod
    def from_toml(cls, source: str | Path, overrides: Sequence[str] = ()) -> Campaign:
        """Return the campaign of a TOML file, of a bundled name, or of a TOML text.

        source: path, bundled name, or TOML text with a newline. Comments are not kept. overrides:
        `key.path=value`, as for `--set`. UserError names file, line, key and expected values.
        """
        if isinstance(source, str) and "\n" in source:
            file, text = None, source
            raw = location.parse_toml(text, "the text")
        else:
            command = "ravenjax campaigns"
            file = location.find_campaign_file(source, "campaigns", "campaign", command)
            raw, text = location.read_toml(file)
        config = loading.from_dict(raw, source=file, text=text, overrides=overrides)
        tables, _ = overriding.apply_overrides(raw, overrides)
        # In the configuration, the path of a robot's file no longer depends on the folder.
        if "robot" in tables["campaign"]:
            tables["campaign"] |= {"robot": config.campaign.robot}
        campaign = cls.__new__(cls)
        campaign._set_content(tables, Path.cwd() if file is None else file.parent, config)
        return campaign

    def to_toml(self, path: str | Path | None = None) -> str:
        """Return the campaign as the text of a TOML file. If `path` is given, write the file.

        Paths of files in the folder of `path` are written relative to this folder. Raise StoreError
        if `path` cannot be written.
        """
        if path is None:
            return writing.format_toml(self._tables)
        path = location.require_path("path", path, "a file to write, or None")
        folder = path.absolute().parent

        def relative(file: str) -> str:
            is_inside = Path(file).is_relative_to(folder)
            return str(Path(file).relative_to(folder)) if is_inside else file

        text = writing.format_toml(_change_file_paths(self._tables, relative))
        files.write_text(path, text)
        return text

    def replace(self, **keys: Any) -> Campaign:
        """Return a copy in which the given keys have new values; None removes a key."""
        other = {key: table for key, table in self._tables.items() if key != SECTION}
        return Campaign(**{**self._tables[SECTION], **other, **keys})

    def run(
        self,
        out: str | Path | None = None,
        engine: str = "auto",
        on_progress: OnProgress | None = None,
        executor: str | None = None,
        workers: int | None = None,
    ) -> CampaignResults:
        """Run the campaign. executor: "local" or "ray". workers: number of parallel tasks of Ray.

        Without `out` the files are in a temporary folder, deleted with the returned object.
        Raise UserError, and StoreError for errors of `out`.
        """
        from ravenjax.notebook.results import CampaignResults

        results = run_config(self.config, out, engine, on_progress, executor, workers)
        return CampaignResults(results.path, results)

    def __setattr__(self, name: str, value: Any) -> None:
        remedy = f"write changed = campaign.replace({name}=...)"
        raise AttributeError(f"a campaign cannot be changed: {remedy}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Campaign) and self.config.model_dump() == other.config.model_dump()

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __repr__(self) -> str:
        return f"rj.Campaign(**{self._tables!r})"

    def _repr_html_(self) -> str:
        from ravenjax.notebook import card

        return card.of_campaign(self.config)


def _campaign_keys(model: type[CampaignConfig]) -> list[str]:
    return list(next(models_in(model.model_fields[SECTION].annotation)).model_fields)


def _signature() -> inspect.Signature:
    """Return a signature with the keys of a Raven-II's campaign, for completion in a notebook."""
    model = config_class_of(robots.find_robot(robots.DEFAULT))
    tables = [key for key in model.model_fields if key != SECTION]
    names = dict.fromkeys(["name", "group", *_campaign_keys(model), *tables])
    kind, defaults = inspect.Parameter.KEYWORD_ONLY, dict.fromkeys(names)
    # These two keys have no default. The others have the default None.
    defaults |= dict.fromkeys(("name", "group"), inspect.Parameter.empty)
    keys = [inspect.Parameter(name, kind, default=defaults[name]) for name in names]
    return inspect.Signature(keys)


Campaign.__signature__ = _signature()  # pyright: ignore[reportAttributeAccessIssue]


def _tables_of(keys: Mapping[str, Any]) -> dict[str, Any]:
    # Separates the keys of [campaign] from other tables, because Python code mixes them.
    section: Any = toml_value(keys.get(SECTION)) or {}
    if not is_table(section):
        raise UserError(f"{SECTION}: got {format_value(section)}, expected a table")
    keys = {**section, **toml_value({key: keys[key] for key in keys if key != SECTION})}
    try:
        model = config_class_of(robot_of({SECTION: keys}))
    except UserError:
        model = CampaignConfig
    campaign_keys = _campaign_keys(model)
    # An unknown key with a table as value is an unknown table, not a key of [campaign].
    tables: dict[str, Any] = {
        key: value
        for key, value in keys.items()
        if key in model.model_fields or (key not in campaign_keys and is_table(value))
    }
    return {SECTION: {key: keys[key] for key in keys if key not in tables}, **tables}


def _change_file_paths(tables: dict[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    # Returns the tables with `change` applied to every value that is the path of a file.
    model = config_class_of(robot_of(tables))
    # Paths of the keys whose values are files, such as ("detector", "file").
    file_keys = {
        (*path, key)
        for path, _, table in tables_of(model)
        for key, field in table.model_fields.items()
        if field.annotation is Path or Path in get_args(field.annotation)
    } | {("parameters", population.KEY)}

    def change_texts(path: tuple[str, ...], value: Any) -> Any:
        # Applies `change` to a text at one of the paths in `file_keys`, also within tables and
        # lists. An item of a list has the path of the list.
        if is_table(value):
            return {key: change_texts((*path, key), inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [change_texts(path, item) for item in cast(list[Any], value)]
        return change(value) if path in file_keys and isinstance(value, str) and value else value

    return {key: change_texts((key,), value) for key, value in tables.items()}


def run_config(
    config: CampaignConfig,
    out: Any,
    engine: str,
    on_progress: OnProgress | None,
    executor: str | None,
    workers: int | None,
) -> Results:
    """Run a campaign and store its results in the folder `out`.

    Without `out`, a temporary folder is deleted with the results. Raise UserError and StoreError.
    """
    if out is not None:
        out = location.require_path("out", out, "a result folder, or None for a temporary one")
    if on_progress is not None and not callable(on_progress):
        raise UserError(
            f"on_progress is {format_value(on_progress)}, expected a function of one Status, or"
            " None"
        )
    chosen = choose_executor(executor, workers)
    return adaptive.run_adaptively(config, out, engine, on_progress=on_progress, executor=chosen)

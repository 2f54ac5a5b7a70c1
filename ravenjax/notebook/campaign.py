"""A campaign as an object: declared in Python or read from a TOML file, checked at once, run."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from ravenjax.campaign import loading, writing
from ravenjax.campaign.file import location, overriding
from ravenjax.campaign.file.config import CampaignConfig, config_class_of, robot_of
from ravenjax.campaign.progress.counts import OnProgress
from ravenjax.errors import UserError, shown
from ravenjax.notebook import running
from ravenjax.notebook.table_classes import SECTION
from ravenjax.notebook.tables import CampaignTable
from ravenjax.store import files

if TYPE_CHECKING:
    from ravenjax.notebook.results import CampaignResults


class Campaign(CampaignTable):
    """A campaign: the keys of [campaign] in a file, and its other tables as objects or plain dicts.

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

    It says what a file says, key by key, and is checked by the same rules when it is made:
    UserError names each key that is wrong, what was got and what to write. Two are equal that
    declare the same, however they were written. It is frozen; `replace` gives a changed one. Files
    that it names are taken from the working directory.
    """

    _config: CampaignConfig

    def _complete(self) -> None:
        self._enter(Path.cwd(), None)

    def _enter(self, folder: Path, config: CampaignConfig | None) -> None:
        """Take files from `folder`; without a config the keys are checked."""
        keys = {
            **_section(self._keys),
            **{key: value for key, value in self._keys.items() if key != SECTION},
        }
        object.__setattr__(
            self, "_keys", {key: self._rooted(key, value, folder) for key, value in keys.items()}
        )
        object.__setattr__(self, "_config", config or loading.from_dict(self.plain()))

    @classmethod
    def from_toml(cls, source: str | Path, overrides: Sequence[str] = ()) -> Campaign:
        """The campaign of a TOML file, of a bundled one by name, or of a text in TOML, which has
        several lines.

        overrides: `key.path=value`, as `--set` on the command line. Comments are not kept. Raises
        UserError that names file, line, key, what was got and what was expected.
        """
        if isinstance(source, str) and "\n" in source:
            file, text = None, source
            raw = location.parsed(text, "the text")
        else:
            file = location.find(source, "campaigns", "campaign", "ravenjax campaigns")
            raw, text = location.read(file)
        config = loading.from_dict(raw, source=file, text=text, overrides=overrides)
        tables, _ = overriding.all_applied(raw, overrides)
        campaign = cls.__new__(cls)
        object.__setattr__(campaign, "_keys", CampaignTable(**tables)._keys)
        campaign._enter(Path.cwd() if file is None else file.parent, config)
        return campaign

    def to_toml(self, path: str | Path | None = None) -> str:
        """The text of a file that declares the same; written to `path`, too, where one is named.

        Files that it names are written from the folder of `path` where they lie in it, else as they
        are. Raises StoreError where `path` cannot be written.
        """
        tables = self.plain()
        if path is not None:
            if not isinstance(path, str | os.PathLike) or not str(path):
                raise UserError(
                    f"path is {shown(path)}, expected the path of a file to write, or None"
                )
            tables = _relative(tables, Path(path).absolute().parent)
        text = writing.text(tables)
        if path is not None:
            files.write_aside(Path(path), lambda target: target.write_text(text, encoding="utf-8"))
        return text

    @property
    def config(self) -> CampaignConfig:
        """What was checked: every key with its default, the library's hazards as plain groups."""
        return self._config

    def plain(self) -> dict[str, Any]:
        """The campaign's tables as a TOML file has them."""
        tables, sections = super().plain(), _sections(self._keys)
        own = {key: value for key, value in tables.items() if key not in sections}
        return {SECTION: own, **{key: value for key, value in tables.items() if key in sections}}

    def run(
        self,
        out: str | Path | None = None,
        engine: str = "auto",
        on_progress: OnProgress | None = None,
        executor: str | None = None,
        workers: int | None = None,
    ) -> CampaignResults:
        """Run it; arguments as of `run`. Without `out` the results lie in a temporary folder that
        goes with them.

        Raises UserError and, for what is wrong with `out`, StoreError.
        """
        from ravenjax.notebook.results import CampaignResults

        if out is not None:
            running.run(self._config, out, engine, on_progress, executor, workers)
            return CampaignResults(Path(out))
        folder = tempfile.TemporaryDirectory(prefix="ravenjax-")
        running.run(self._config, Path(folder.name), engine, on_progress, executor, workers)
        return CampaignResults(Path(folder.name), folder)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Campaign) and self._config.model_dump() == other._config.model_dump()
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def _repr_html_(self) -> str:
        from ravenjax.notebook import card

        return card.of_campaign(self._config)


def _section(keys: Mapping[str, Any]) -> Mapping[str, Any]:
    """The table [campaign] of a file's tables."""
    section = keys.get(SECTION)
    if section is not None and not isinstance(section, Mapping):
        raise UserError(f"{SECTION}: got {shown(section)}, expected a table")
    return section or {}


def _sections(keys: Mapping[str, Any]) -> set[str]:
    """Which keys are tables beside [campaign]: those of the robot's model, and unknown ones that
    hold tables.
    """
    try:
        model: type[BaseModel] = config_class_of(robot_of({SECTION: keys}))
    except UserError:
        model = CampaignConfig
    inner = next(loading.models_in(model.model_fields[SECTION].annotation)).model_fields
    return {
        key
        for key, value in keys.items()
        if key in model.model_fields
        or (key not in inner and (hasattr(value, "plain") or isinstance(value, dict)))
    }


def _relative(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Tables in which paths of files within `folder` begin there."""
    return {key: _relative_at((key,), value, folder) for key, value in tables.items()}


def _relative_at(path: tuple[str, ...], value: Any, folder: Path) -> Any:
    if isinstance(value, dict):
        return {key: _relative_at((*path, key), one, folder) for key, one in value.items()}
    if isinstance(value, list):
        return [_relative_at(path, one, folder) for one in value]
    if path in set(_file_keys()) and isinstance(value, str) and Path(value).is_relative_to(folder):
        return str(Path(value).relative_to(folder))
    return value


def _file_keys() -> Iterator[tuple[str, ...]]:
    """Paths of keys that name files."""
    from ravenjax.campaign.population import KEY
    from ravenjax.notebook.table_classes import CLASSES, tables

    yield ("parameters", KEY)
    for path, model in tables():
        yield from ((*path, key) for key in CLASSES[model.__name__]._files)

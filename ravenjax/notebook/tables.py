"""The tables of a campaign file as classes: `Group`, `Fault`, .. and `CampaignTable`, the whole.

Static types are in `tables.pyi`, which `ravenjax reference --types` writes from the models that
make the classes.
"""

from ravenjax.notebook.table_classes import CLASSES, CampaignTable

__all__ = [*CLASSES, CampaignTable.__name__]  # pyright: ignore[reportUnsupportedDunderAll]

globals().update(CLASSES)

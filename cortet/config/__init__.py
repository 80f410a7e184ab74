"""The typed configuration: every key with its unit, its default and what it does.

`load` reads a YAML file (or the dict that Snakemake passes). `render` writes it with every key explained, for
`cortet config`. A job of the workflow needs the section of its stage alone, so the rest loads when it is asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cortet.config.files import keys_not_given, load, read, render
    from cortet.config.sections import Scan
    from cortet.config.settings import SETTINGS
    from cortet.config.stages import Config

__all__ = ["SETTINGS", "Config", "Scan", "keys_not_given", "load", "read", "render"]
_MODULES = {"SETTINGS": "settings", "Config": "stages", "Scan": "sections"}


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module(f"{__name__}.{_MODULES.get(name, 'files')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

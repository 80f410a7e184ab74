"""The typed configuration: every key with its unit, its default and what it does.

`load` reads a YAML file (or the dict that Snakemake passes). `render` writes it with every key explained, for
`cortet config`. Every job loads all of it, so no module here imports NumPy's heavier relatives.
"""

from cortet.config.files import keys_not_given, load, read, render
from cortet.config.model import Config
from cortet.config.sections import Scan
from cortet.config.settings import SETTINGS

__all__ = ["SETTINGS", "Config", "Scan", "keys_not_given", "load", "read", "render"]

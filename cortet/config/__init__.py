"""The typed configuration: every key with its unit, its default and what it does.

`load` reads a YAML file (or the dict that Snakemake passes). `render` writes it with every key explained, for
`cortet config`. `Config.arguments` gives the plain arguments of one step, which the workflow compares between
runs.
"""

from cortet.config.files import keys_not_given, load, read, render
from cortet.config.model import STEPS, Config, version_of
from cortet.config.sections import Scan
from cortet.config.settings import SETTINGS

__all__ = ["SETTINGS", "STEPS", "Config", "Scan", "keys_not_given", "load", "read", "render", "version_of"]

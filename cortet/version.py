"""The version of cortet, which files record."""

__version__: str = "0.2.0"

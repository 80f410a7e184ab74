"""Everything that people look at: tables, figures, pages, pictures, the methods paragraph."""

from pathlib import Path

#: published numbers, columns of tables, references
DATA = Path(__file__).with_name("data")

"""The experiments of the CORTET paper (arXiv:2607.12157) on a cohort: their tables and figures."""

from pathlib import Path

#: columns of tables
DATA = Path(__file__).with_name("data")

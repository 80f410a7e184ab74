"""A line per case instead of Snakemake's messages: `snakemake --logger cortet`; `cortet run` does so by itself."""

from cortet.cohort.terminal import LogHandler

__all__ = ["LogHandler"]

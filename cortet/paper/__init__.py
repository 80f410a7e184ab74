"""The experiments of the CORTET paper (arXiv:2607.12157) on a cohort: their tables and figures."""

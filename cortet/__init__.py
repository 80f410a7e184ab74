"""cortet: from cortical surfaces to certified simulation meshes (method: CORTET, arXiv:2607.12157)."""

__version__ = "0.1.0"

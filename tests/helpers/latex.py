"""LaTeX of the system, where it has one."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

#: as wide as both columns of a journal
PAGE = r"""\documentclass{article}
\usepackage[textwidth=183mm, textheight=250mm]{geometry}
\usepackage{booktabs}
\begin{document}
\noindent\input{TABLE}
\end{document}
"""


def require_fits(table: Path) -> None:
    """Fail if a table does not compile, or is wider than both columns of a journal."""
    if shutil.which("pdflatex") is None:
        pytest.skip("there is no pdflatex")
    (table.parent / "page.tex").write_text(PAGE.replace("TABLE", table.name))
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "page.tex"]
    log = subprocess.run(command, cwd=table.parent, capture_output=True, text=True, check=False)
    assert log.returncode == 0, log.stdout[-2000:]
    assert "Overfull" not in log.stdout, log.stdout[-2000:]

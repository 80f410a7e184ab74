"""The documentation builds without a warning, loads nothing from elsewhere, and every command in it runs.

The blocks of a page run in their order, in one folder that looks like a checkout. A block that is not run says why in a
comment before it: `<!-- not run: REASON -->`; its `cortet` commands are parsed all the same.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cortet.cli import app, main
from tests.integration.documented import PAGES, ROOT, blocks, coarse, like, make_checkout
from tests.integration.study import Study

pytestmark = pytest.mark.thorough

BLOCKS = list(blocks())
#: characters that make a line more than a program and its arguments
SHELL = re.compile(r"[|&;<>$`*]")


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(folder / "cache"), "docs"]
    done = subprocess.run([*command, str(folder / "html")], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "html"


def test_the_site_loads_nothing_from_elsewhere(site):
    loads = re.compile(r"""<(?:script|img|iframe|source)[^>]*\ssrc="(?:https?:)?//|<link[^>]*\shref="(?:https?:)?//""")
    pages = list(site.rglob("*.html"))
    assert len(pages) > len(PAGES)  # those of the index and the search, too
    assert not [page.name for page in pages if loads.search(page.read_text(encoding="utf-8"))]
    sheets = [path for path in site.rglob("*.css") if re.search(r"(url\(|@import)[^;]*//", path.read_text())]
    assert not sheets


@pytest.fixture(scope="module")
def checkout(finished: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that looks like a checkout, with the results of a tiny cohort and a mesh."""
    folder = tmp_path_factory.mktemp("checkout")
    make_checkout(folder)
    shutil.copytree(finished.folder / "derivatives", folder / "derivatives")
    run("cortet mesh x.surf.gii --ga 28 --cell-size 4 --field thickness=x.shape.gii -o x.vtu", folder)
    return folder


@pytest.mark.parametrize("block", [pytest.param(block, id=block.name) for block in BLOCKS])
def test_what_a_page_shows_is_what_happens(block, checkout):
    if block.needs and not shutil.which(block.needs):
        pytest.skip(f"{block.needs} is not installed")
    if block.file:
        (checkout / block.file).write_text(coarse(block.text))
        return
    for command, shown in block.commands:
        if block.not_run:
            if command.startswith("cortet "):
                app().parse_args(shlex.split(command)[1:], print_error=False, exit_on_error=False)
            continue
        output = run(coarse(command), checkout)
        alike = like if command.startswith(("cortet", "cat")) else str.strip  # coarse meshes have other numbers
        missing = [line for line in shown if alike(line) not in map(alike, output.splitlines())]
        assert not missing, f"`{command}` does not print {missing}, but\n{output}"


def run(command: str, folder: Path) -> str:
    """Output of a command that must end well; those of cortet run in this process, which has its libraries loaded."""
    command, *_ = re.split(r"\s+#\s", command)
    if command.startswith("cortet ") and not SHELL.search(command):
        output = io.StringIO()
        with contextlib.chdir(folder), contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            status = main(shlex.split(command)[1:])
        assert status == 0, f"{command}: exit code {status}\n{output.getvalue()}"
        return output.getvalue()
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["sh", "-c", command], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout

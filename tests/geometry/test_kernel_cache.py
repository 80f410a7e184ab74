"""A kernel is compiled once per machine, and never used after an edit of anything that it is made of."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cortet.geometry import kernel_cache


@pytest.mark.parametrize(
    ("edited", "other"), [("kernels.py", True), ("room/called.py", True), ("constants.py", True), ("other.py", False)]
)
def test_an_edit_of_what_a_kernel_is_made_of_is_another_key(edited, other, tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache, "_PACKAGE", tmp_path)
    (tmp_path / "room").mkdir()
    (tmp_path / "kernels.py").write_text("from cortet.room import called\nfrom numpy import pi\n")
    (tmp_path / "room/called.py").write_text("import cortet.constants\n")
    (tmp_path / "constants.py").write_text("SIZE = 3\n")
    (tmp_path / "other.py").write_text("import cortet.kernels\n")

    def key() -> str:
        kernel_cache.source_key.cache_clear()
        kernel_cache._imports.cache_clear()
        return kernel_cache.source_key(tmp_path / "kernels.py")

    before = key()
    (tmp_path / edited).write_text((tmp_path / edited).read_text() + "# edited\n")
    assert (key() != before) == other


def test_the_folder_that_numba_is_given_has_kernels_by_their_source_too(tmp_path):
    """Numba alone would use a stale kernel there, after an edit of what it is made of."""
    code = "from cortet.measure.quality import _quality as kernel; print(kernel._cache.cache_path)"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).parent == tmp_path / "cortet/kernels"


def test_without_a_place_for_caches_a_temporary_one_is_used_and_said(tmp_path):
    """As with a home that cannot be written to; jobs of the process inherit the place."""
    code = "import os; from cortet.geometry.kernel_cache import cache_folder; print(cache_folder(), cache_folder(), "
    code += "os.environ['XDG_CACHE_HOME'])"
    environment = {key: value for key, value in os.environ.items() if key != "XDG_CACHE_HOME"}
    environment |= {"HOME": "/proc/nowhere", "NUMBA_CACHE_DIR": "/proc/nowhere", "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    own = tmp_path / f"cortet-{os.getuid()}"
    assert done.stdout.split() == [str(own / "cortet/kernels")] * 2 + [str(own)]
    assert done.stderr.count(str(own)) == 1
    assert own.stat().st_mode & 0o777 == 0o700
    own.chmod(0o777)  # somebody else may have put compiled code there
    again = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    used = Path(again.stdout.split()[-1])
    assert used != own and used.parent == tmp_path


FORKED = """
import multiprocessing, cortet
ball = cortet.phantom(28, subdivisions=3)

def meshed(_):
    return cortet.mesh(ball, 6.0, progress=False).certified

meshed(0)
with multiprocessing.get_context("fork").Pool(1) as pool:
    try:
        pool.map_async(meshed, [1]).get(timeout=60)
    except cortet.CortetError as error:
        print(error)
"""


def test_a_process_that_was_forked_after_cortet_ran_is_told_to_be_spawned():
    """OpenMP ended it without a word, and the pool waited for it for ever."""
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, timeout=120, check=False)
    assert 'get_context("spawn")' in done.stdout, done.stderr

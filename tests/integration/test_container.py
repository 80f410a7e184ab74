"""The container is built from Debian's packages and meshes a phantom, as a user who is not root."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
missing = [name for name in ("buildah", "mmdebstrap") if not shutil.which(name)]


@pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")
@pytest.mark.skipif("CORTET_TEST_CONTAINER" not in os.environ, reason="takes ten minutes: set CORTET_TEST_CONTAINER=1")
def test_it_is_built_and_meshes():
    done = subprocess.run([ROOT / "tools/container.sh"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    size, unit = re.search(r"cortet\s+([\d.]+) (MB|GB)", done.stdout).groups()  # type: ignore[union-attr]
    assert unit == "MB" or float(size) < 3
    assert "user cortet\n" in done.stdout and "the image cannot be written to\n" in done.stdout
    assert "\ncertified\n" in done.stdout

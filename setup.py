"""The wheel brings the workflow along, in the package's folder `workflow`; everything else stands in pyproject.toml."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

WORKFLOW = ("Snakefile", "config.yaml", "rules", "scripts", "reports", "profiles", "envs", "demo")


class BuildWithWorkflow(build_py):
    """Copy the workflow into the built package; an editable install finds it in the checkout."""

    def run(self) -> None:
        """Build as always, then copy."""
        super().run()
        if self.editable_mode:
            return
        for name in WORKFLOW:
            source, target = Path(name), Path(self.build_lib, "cortet", "workflow", name)
            if source.is_dir():
                shutil.copytree(source, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)


# An editable install puts the checkout on the path, where Snakemake looks for plugins by their names: it does not see
# modules that an import hook knows.
setup(cmdclass={"build_py": BuildWithWorkflow}, options={"editable_wheel": {"mode": "compat"}})

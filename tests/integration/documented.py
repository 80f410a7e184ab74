"""The commands of the documentation, as its pages hold them, and the folder in which the tests run them."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import nibabel
import numpy as np

from cortet.formats.gifti import write_surface
from cortet.formats.ownership import guarded
from cortet.phantoms import phantom

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

_BLOCK = re.compile(
    r"(?:^[ \t]*<!-- (?P<mark>not run|needs): (?P<why>[^\n]+) -->\n\s*?)?"
    r"^(?P<indent>[ \t]*)(?P<fence>```+)(?:\{code-block\} )?(?P<language>\w+)\n"
    r"(?:[ \t]*:caption: (?P<caption>\S+)\n\n)?"
    r"(?P<text>.*?)^(?P=indent)(?P=fence)$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: Path
    line: int
    language: str
    text: str
    #: name of the file whose content it is
    file: str | None
    #: why it is not run
    not_run: str | None
    #: program that it needs
    needs: str | None

    @property
    def name(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def commands(self) -> list[tuple[str, list[str]]]:
        """Each command with the lines that the page shows as its output."""
        if self.language == "sh":
            lines = (line.strip() for line in self.text.splitlines())
            return [(line, []) for line in lines if line and not line.startswith("#")]
        found: list[tuple[str, list[str]]] = []
        for line in self.text.splitlines():
            if line.startswith("$ "):
                found.append((line[2:], []))
            elif line.strip():
                found[-1][1].append(line)
        return found


def blocks() -> Iterator[Block]:
    """Blocks of commands and of files of all pages, in their order."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for found in _BLOCK.finditer(text):
            if found["language"] in ("sh", "console") or found["caption"]:
                yield Block(
                    page=page,
                    line=text.count("\n", 0, found.start("fence")) + 1,
                    language=found["language"],
                    text=textwrap.dedent(found["text"]),
                    file=found["caption"],
                    not_run=found["why"] if found["mark"] == "not run" else None,
                    needs=found["why"] if found["mark"] == "needs" else None,
                )


def coarse(text: str) -> str:
    """The same command or file with fewer triangles and larger cells; of `make` and Snakemake only the plan."""
    text = re.sub(r"(--cell-size |\"cell_size\": )1\.6", r"\g<1>4", text)
    if re.match("cortet mesh ", text) and "--cell-size" not in text:
        text += " --cell-size 4"
    text = re.sub("^cortet phantom ", "cortet phantom --subdivisions 3 ", text)
    text = re.sub("^cortet fold ", "cortet fold --force ", text)
    text = re.sub(r"^cortet fold (?!.*--end).*--ga (\d+).*", r"\g<0> --end \1.02", text)
    text = re.sub(r"^cortet cohort scan .*", r"\g<0> --force", text)  # pages share a folder, and name the same sheet
    return re.sub(r"^(make|snakemake)\b(?!.*--dry-run)", r"\1 --dry-run", text)


def like(line: str) -> str:
    """A line of output without what differs between a coarse mesh and a fine one: numbers, and how many spaces."""
    return " ".join(re.sub(r"[+-]?\d+(\.\d+)?(e[+-]?\d+)?", "#", line).split())


def make_checkout(folder: Path) -> None:
    """A folder that looks like this checkout, with the surfaces that the pages speak of."""
    for path in ROOT.iterdir():
        if not path.name.startswith(".") and path.name != "derivatives":
            (folder / path.name).symlink_to(path)
    (folder / ".venv").symlink_to(sys.prefix)
    surface = phantom(28, subdivisions=3)
    with guarded([]):  # as `cortet phantom` of another page made it
        write_surface(surface, folder / "x.surf.gii")
    thickness = nibabel.gifti.GiftiDataArray(np.linspace(1, 2, len(surface.points), dtype=np.float32))
    nibabel.save(nibabel.GiftiImage(darrays=[thickness]), folder / "x.shape.gii")
    make_release(folder / "dhcp")


def make_release(folder: Path) -> None:
    """A data release of three participants, one of them without an age."""
    for number, (age, hemi) in enumerate([(26.5, "left"), (31, "right"), (None, "right")], start=1):
        participant, session = f"sub-CC0000{number}XX0{number}", f"ses-{number}00"
        anatomy = folder / participant / session / "anat"
        anatomy.mkdir(parents=True)
        surface = phantom(age or 28, hemisphere=hemi[0].upper(), subdivisions=3, seed=number)
        write_surface(surface, anatomy / f"{participant}_{session}_hemi-{hemi}_wm.surf.gii")
        if age:
            table = f"session_id\tscan_age\n{session}\t{age}\n"
            (folder / participant / f"{participant}_sessions.tsv").write_text(table)

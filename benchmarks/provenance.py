"""Random edits between runs: certificate, mesh and input must belong together after each of them.

    python benchmarks/provenance.py [--sequences 200] [--seed 0] [--cores 2] [-o FOLDER]

A cohort of two small surfaces is meshed. Then each sequence edits it one to four times, as users do (a surface is
replaced by one with an older time, two subjects are swapped, files and folders are renamed and moved, parameters
change, another working folder is used, everything is touched), runs the workflow once and compares what there is with
what was asked for. Exits with 1 if a certificate, a record or a mesh is of another input or of other parameters.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cortet.cohort.sheet import Case, write_sheet
from cortet.config import load
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.hashing import sha256
from cortet.geometry.icosphere import icosphere
from cortet.geometry.topology import enclosed_volume
from cortet.meshes import TriSurface
from cortet.stages import STAGES

ROOT = Path(__file__).parents[1]
#: mm
CELL_SIZE = 4.0
#: the size of no two surfaces is alike, so that a mesh of another one has another volume
_GROWTH = 1.12


@dataclass
class World:
    """What a user has: surfaces, a configuration, working folders and an output folder."""

    folder: Path
    rng: random.Random
    output: str = "derivatives"
    working: str = "here"
    surfaces: dict[str, str] = field(default_factory=lambda: {"a": "surfaces/a.surf.gii", "b": "surfaces/b.surf.gii"})
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    made: int = 0

    def surface(self, case: str) -> Path:
        """File of the surface of a case."""
        return self.folder / self.surfaces[case]

    def config(self) -> dict[str, Any]:
        """The configuration, as the working folder has it."""
        defaults = {"generate": {"cell_size": CELL_SIZE}, "certify": {"max_area_change": 0.3, "max_volume_change": 0.5}}
        chosen = {name: {**defaults.get(name, {}), **self.settings.get(name, {})} for name in defaults | self.settings}
        return {"cohort": {"sheet": "../cohort.tsv"}, "output": f"../{self.output}", **chosen}

    def new_surface(self, path: Path) -> None:
        """Write a surface that no case had before."""
        self.made += 1
        ball = icosphere(3)
        points = ball.points * (12 * _GROWTH ** (self.made % 7)) * [1, 1 + 1e-3 * self.made, 0.9]
        path.parent.mkdir(parents=True, exist_ok=True)
        write_surface(TriSurface(points, ball.faces), path)

    def run(self, cores: int) -> int:
        """Run the workflow in the working folder."""
        rows = [Case(name, None, "L", 24.0, self.surface(name)) for name in self.surfaces]
        write_sheet(rows, self.folder / "cohort.tsv")
        place = self.folder / self.working
        place.mkdir(exist_ok=True)
        (place / "config.yaml").write_text(yaml.safe_dump(self.config()), encoding="utf-8")
        command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--cores", str(cores)]
        with (self.folder / "log").open("a", encoding="utf-8") as log:
            return subprocess.run([*command, "meshes"], cwd=place, stdout=log, stderr=log, check=False).returncode


def replaced_by_an_older_file(world: World) -> None:
    """A new surface under an old name, with a time of 2001."""
    path = world.surface(world.rng.choice("ab"))
    world.new_surface(path)
    os.utime(path, (1e9, 1e9))


def two_subjects_swapped(world: World) -> None:
    """Their files change places and keep their times."""
    first, second = world.surface("a"), world.surface("b")
    aside = first.with_name("aside")
    first.rename(aside)
    second.rename(first)
    aside.rename(second)


def a_surface_renamed(world: World) -> None:
    """The file and its row of the sheet."""
    case = world.rng.choice("ab")
    old = world.surface(case)
    world.made += 1
    world.surfaces[case] = f"surfaces/{case}{world.made}.surf.gii"
    old.rename(world.surface(case))


def output_moved(world: World) -> None:
    """The output folder gets another name."""
    old, world.made = world.folder / world.output, world.made + 1
    world.output = f"derivatives{world.made}"
    old.rename(world.folder / world.output)


def everything_moved(world: World) -> None:
    """The folder of all others gets another name."""
    world.made += 1
    world.folder = world.folder.rename(world.folder.with_name(f"world{world.made}"))


def parameters_changed(world: World) -> None:
    """One key of the configuration."""
    section, key, values = world.rng.choice(
        [
            ("clean", "thresholds", [[0.7, 0.5, 0.3], [0.6, 0.4], [0.5]]),
            ("certify", "q_max", [0.6, 0.55, 0.5]),
            ("smooth_surface", "enabled", [True, False]),
            ("reconnect", "threshold", [0.3, 0.31]),
            ("export", "cortex_depth", [1.5, 2.0]),
        ]
    )
    world.settings.setdefault(section, {})[key] = world.rng.choice(values)


def another_working_folder(world: World) -> None:
    """Where Snakemake is started and keeps its notes."""
    world.working = world.rng.choice(["here", "there", "elsewhere"])


def everything_touched(world: World) -> None:
    """All files get the time of now."""
    for path in world.folder.rglob("*"):
        if path.is_file() and ".snakemake" not in path.parts:
            path.touch()


EDITS: tuple[Callable[[World], None], ...] = (
    replaced_by_an_older_file,
    two_subjects_swapped,
    a_surface_renamed,
    output_moved,
    everything_moved,
    parameters_changed,
    another_working_folder,
    everything_touched,
)


def contradictions(world: World) -> Iterator[str]:
    """What in the output is not of the input and the parameters that there are now."""
    config = load(world.config())
    for case in world.surfaces:
        path, meshes = world.surface(case), world.folder / world.output / f"sub-{case}/mesh"
        wanted, name = sha256(path), f"sub-{case}_hemi-L_res-{round(1000 * CELL_SIZE)}um_desc-latticeSolver"
        certificate = json.loads((meshes / f"{name}_certificate.json").read_text(encoding="utf-8"))
        if not certificate["certified"]:
            yield f"{case}: not certified"
        if certificate["input"]["sha256"] != wanted:
            yield f"{case}: the certificate names another surface"
        facts = {"gestational_age": 24.0, "hemisphere": "L", "cell_size": CELL_SIZE, "mesher": "lattice"}
        for step, recorded in certificate["parameters"].items():
            asked = config.record(step, facts | {"source": recorded.get("source"), "nested": False})
            if json.loads(json.dumps(asked)) != recorded:
                yield f"{case}: {step} ran with other parameters"
        # a stage that the configuration bypasses now may have left its record of another time, which nothing reads
        labels = [STAGES[step].label for step in certificate["parameters"] if step in STAGES]
        records = (world.folder / world.output / f"sub-{case}").rglob("*_white.json")
        for record in (one for one in records if any(f"desc-{label}_" in one.name for label in labels)):
            if json.loads(record.read_text(encoding="utf-8"))["input_sha256"] != {"surface": wanted}:
                yield f"{case}: {record.name} is of another surface"
        solver = meshes / f"{name}_tetmesh.mesh"
        sidecar = json.loads(solver.with_name(solver.name + ".json").read_text(encoding="utf-8"))
        surface = read_surface(path)
        volume = abs(enclosed_volume(surface.points, surface.faces))
        if sidecar["files"] != {solver.name: sha256(solver)}:
            yield f"{case}: the sidecar is of another file"
        if sidecar["made_from"]["given"]["cortex"]["sha256"] != wanted:
            yield f"{case}: the sidecar names another surface"
        if not np.isclose(sidecar["volume_mm3"], volume, rtol=0.12):
            yield f"{case}: the mesh has {sidecar['volume_mm3']:.0f} mm3, its surface {volume:.0f}"


def main() -> int:
    """Make the cohort, edit it, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sequences", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="default: a temporary one")
    options = parser.parse_args()
    place = (options.output or Path(tempfile.mkdtemp())).resolve()
    world = World(place / "world", random.Random(options.seed))
    for case in world.surfaces:
        world.new_surface(world.surface(case))
    edits, found, began = Counter[str](), [], time.time()
    for number in range(options.sequences + 1):
        chosen = [] if number == 0 else world.rng.choices(EDITS, k=world.rng.randint(1, 4))
        for edit in chosen:
            edit(world)
        names = [edit.__name__ for edit in chosen]
        edits.update(names)
        failed = world.run(options.cores)
        problems = ["the run failed"] if failed else list(contradictions(world))
        found += [f"{number}: {', '.join(names)}: {problem}" for problem in problems]
        if problems:
            print(found[-len(problems) :], flush=True)
    print(f"{options.sequences} sequences in {time.time() - began:.0f} s: {len(found)} contradictions")
    for name, count in sorted(edits.items()):
        print(f"{count:6} {name.replace('_', ' ')}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())

"""What do other programs read in files for solvers, and what does writing and reading cost?

    python benchmarks/read_back.py [--tags tissue]
    python benchmarks/read_back.py formats [--tets 2e6] [--formats abaqus febio ...]

The mesh is a cube with a white matter inside, and a volume whose labels 3 (left) and 7 (right) cross both regions. Each
format is written as an export is, and read by every program that reads it. FEBio's files are read by pyfebio; those of
openCARP and BrainGrowth, which no package reads, as their manual and loader do. `worst` is the largest difference of
the field 1 + 2 x + 3 y + 4 z from its value where the program finds the node.

`formats` measures every writer and reader on a cube with fields and sets, each in a process of its own: CPU
seconds, MB of its peak above what it had before, and the size of all files of the format.
"""

from __future__ import annotations

import importlib
import itertools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from _frame import Row, Table, alone, command, spent
from cubes import cube_mesh

from cortet.formats import FORMATS, read_mesh
from cortet.geometry.topology import boundary_faces
from cortet.meshes import REGION, TetMesh
from cortet.solver_files.export import export
from cortet.solver_files.sets import named_sets
from cortet.stages.solver_ready import surface_nodes_first


@dataclass(frozen=True)
class Seen:
    """What a program finds in a file."""

    points: np.ndarray
    #: (m, 4) tetrahedra or (m, 3) triangles
    cells: np.ndarray
    #: name -> values of the nodes
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    #: (m,) number of the region of each tetrahedron, and the name of each number; None, and none, where it finds none
    region: np.ndarray | None = None
    names: dict[int, str] = field(default_factory=dict)
    #: name -> tetrahedra of each set
    sets: dict[str, np.ndarray] = field(default_factory=dict)


def by_meshio(module: str, tags: str) -> Callable[[Path], Seen]:
    """Reader of meshio, whose cell data `tags` are the numbers of regions."""

    def read(path: Path) -> Seen:
        found = importlib.import_module(f"meshio.{module}").read(str(path))
        chosen = [number for number, block in enumerate(found.cells) if block.type == "tetra"]
        region = [found.cell_data[tags][number] for number in chosen] if tags in found.cell_data else None
        return Seen(
            found.points,
            np.concatenate([found.cells[number].data for number in chosen]),
            dict(found.point_data),
            None if region is None else np.concatenate(region),
            {int(one[0]): name for name, one in found.field_data.items() if len(one) == 2 and one[1] == 3},
            {name: np.concatenate(some) for name, some in found.cell_sets.items()} if module == "abaqus" else {},
        )

    return read


def by_vtk(path: Path) -> Seen:
    """PyVista, for VTU and STL."""
    import pyvista

    grid = pyvista.read(str(path))
    if isinstance(grid, pyvista.PolyData):
        return Seen(np.asarray(grid.points), np.asarray(grid.regular_faces))
    fields = {name: np.asarray(grid.point_data[name]) for name in grid.point_data}
    tags = {name: np.asarray(grid.field_data[name]) for name in grid.field_data}
    names = {int(one[0]): name for name, one in tags.items() if len(one) == 2 and one[1] == 3}
    region = np.asarray(grid.cell_data[REGION]) if REGION in grid.cell_data else None
    return Seen(grid.points, grid.cells_dict[10], fields, region, names)


def by_gmsh(path: Path) -> Seen:
    """Gmsh, for its own files and those of Nastran."""
    import gmsh

    gmsh.initialize(argv=[], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        tags, points, _ = gmsh.model.mesh.getNodes()
        cells, region, names = [], [], {}
        for _, entity in gmsh.model.getEntities(3):
            cells.append(gmsh.model.mesh.getElementsByType(4, entity)[1].reshape(-1, 4))
            region.append(np.full(len(cells[-1]), entity))
            if name := gmsh.model.getPhysicalName(3, entity):
                names[entity] = name
        fields = {}
        for view in gmsh.view.getTags():
            kind, _, values, _, components = gmsh.view.getHomogeneousModelData(view, 0)
            if kind == "NodeData":
                fields[gmsh.view.option.getString(view, "Name")] = values.reshape(-1, components)
    finally:
        gmsh.finalize()
    order = np.argsort(tags)
    corners = np.concatenate(cells).astype(int) - 1
    fields = {name: values[:, 0] if values.shape[1] == 1 else values for name, values in fields.items()}
    return Seen(points.reshape(-1, 3)[order], corners, fields, np.concatenate(region), names)


def by_pyfebio(path: Path) -> Seen:
    """The model of FEBio's specification that pyfebio has."""
    from pyfebio.model import Model

    model = Model.from_xml(path.read_bytes())

    def table(rows: Sequence[Any]) -> np.ndarray:
        return np.array([str(row.text).split(",") for row in rows], float)

    parts = [table(part.all_elements).astype(int) - 1 for part in model.mesh_.elements]
    ids = np.concatenate([[row.id for row in part.all_elements] for part in model.mesh_.elements])
    number = {material.name: int(material.id) for material in model.material_.all_materials}
    domains = {domain.name: number[domain.mat] for domain in model.meshdomains_.solid_domains}
    region = np.repeat([domains[part.name] for part in model.mesh_.elements], [len(part) for part in parts])
    fields = {one.name: table(one.all_nodes).squeeze() for one in model.meshdata_.node_data} if model.meshdata_ else {}
    order, points = np.argsort(ids), table(model.mesh_.nodes[0].all_nodes)
    names = {number[name]: name for name in domains}
    return Seen(points, np.concatenate(parts)[order], fields, region[order], names)


def by_opencarp(path: Path) -> Seen:
    """The text files of openCARP, in um, as its manual describes them."""
    stem = str(path.with_suffix(""))
    points = np.loadtxt(f"{stem}.pts", skiprows=1) / 1000
    rows = np.loadtxt(f"{stem}.elem", int, skiprows=1, usecols=range(1, 6))
    table = [line.split("\t") for line in Path(f"{stem}.regions.tsv").read_text().splitlines()[1:]]
    suffixes = itertools.chain(path.parent.glob("*.dat"), path.parent.glob("*.vec"))
    fields = {file.name.split(".")[-2]: np.loadtxt(file) for file in suffixes}
    return Seen(points, rows[:, :4], fields, rows[:, 4], {int(tag): name for tag, name in table})


def by_braingrowth(path: Path) -> Seen:
    """The loader of BrainGrowth: x and y change places, and so do the last two nodes of a tetrahedron."""
    lines = path.read_text().split("\n")
    count = int(lines[0])
    points = np.array([line.split() for line in lines[1 : count + 1]], float)[:, [1, 0, 2]]
    rows = np.array([line.split() for line in lines[count + 2 : count + 2 + int(lines[count + 1])]], int)
    return Seen(points, rows[:, [1, 2, 4, 3]] - 1, region=rows[:, 0])


def by_nibabel(path: Path) -> Seen:
    """NiBabel, for GIfTI."""
    import nibabel

    image: Any = nibabel.load(path)
    points, faces = image.agg_data(("pointset", "triangle"))
    return Seen(points, faces, {one.meta["Name"]: one.data for one in image.darrays if "Name" in one.meta})


#: format -> program -> its reader
READERS: dict[str, dict[str, Callable[[Path], Seen]]] = {
    "vtu": {"PyVista": by_vtk, "meshio": by_meshio("vtu", REGION)},
    "braingrowth": {"BrainGrowth": by_braingrowth},
    "abaqus": {"meshio": by_meshio("abaqus", REGION)},
    "febio": {"pyfebio": by_pyfebio},
    "fenics": {"meshio": by_meshio("xdmf", REGION)},
    "gmsh": {"Gmsh": by_gmsh},
    "nastran": {"meshio": by_meshio("nastran", "nastran:ref"), "Gmsh": by_gmsh},
    "carp": {"openCARP": by_opencarp},
    "stl": {"PyVista": by_vtk},
    "gifti": {"NiBabel": by_nibabel},
}

#: labels of the volume, by their keys
LABELS = {3: "left", 7: "right"}


def model(tags: str | None = None) -> TetMesh:
    """A cube of 8 mm: cortex around white matter, labels, and the linear field."""
    mesh = surface_nodes_first(cube_mesh(4, side=8.0))[0]
    centre = mesh.points[mesh.cells].mean(axis=1)
    region = np.where((np.abs(centre - 4) < 2).all(axis=1), 2, 1).astype(np.int32)
    tissue = np.where(centre[:, 0] < 4, 3, 7).astype(np.int32)
    mesh = replace(mesh, point_data={"linear": linear(mesh.points)}, cell_data={REGION: region, "tissue": tissue})
    return named_sets(mesh, inner=["white"], label_names={"tissue": LABELS}, tissues=["tissue"], tags=tags)


def linear(points: np.ndarray) -> np.ndarray:
    """A field that no other order of nodes gives."""
    return np.asarray(1 + points @ [2.0, 3.0, 4.0])


def seen(mesh: TetMesh, name: str, folder: Path) -> Iterator[tuple[str, Seen]]:
    """What each program finds in the file of a format."""
    path = folder / f"m{FORMATS[name].suffix}"
    export(mesh, path, solver=name)
    for program, read in READERS[name].items():
        yield program, read(path)


def in_words(found: Seen) -> tuple[str, str, str]:
    """Tags and numbers of tetrahedra, names or sets, and the largest error of the field."""
    count = np.unique(found.region, return_counts=True) if found.region is not None else ((), ())
    tags = ", ".join(f"{tag:g}: {times}" for tag, times in zip(*count, strict=True))
    names = ", ".join(f"{tag} {called}" for tag, called in found.names.items())
    names = names or ", ".join(f"{called}: {len(some)}" for called, some in found.sets.items())
    off = "no field"
    if "linear" in found.fields:
        off = f"{np.abs(found.fields['linear'] - linear(found.points)).max():.1e}"
    return tags or "none", names or "none", off


def read_back(*, tags: str | None = None) -> None:
    """A line for each format and program.

    tags : the volume whose labels take the place of the regions
    """
    mesh = model(tags)
    print(f"{'format':<13}{'read by':<13}{'tags and numbers of tetrahedra':<32}{'names, or sets: tetrahedra':<34}worst")
    for name in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            for program, found in seen(mesh, name, Path(folder)):
                numbers, names, off = in_words(found)
                print(f"{name:<13}{program:<13}{numbers:<32}{names:<33} {off}")


def formats(*, tets: float = 2e6, formats: Sequence[str] = tuple(FORMATS)) -> None:
    """Write and read a cube in each format."""
    table = Table(
        *("format", "tets", "write_s", "write_Mtets_per_s", "write_MB", "read_s", "read_Mtets_per_s", "read_MB"),
        *("size_MB", "why_not"),
    )
    for name in formats:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"cube{FORMATS[name].suffix}"
            row: dict[str, Any] = {"format": name} | alone(cost, "write", name, path, tets)
            if name not in ("braingrowth", "febio", "stl", "gifti"):  # which are no meshes that cortet reads
                row |= alone(cost, "read", name, path, tets)
            for task in ("write", "read"):
                if f"{task}_s" in row:
                    row[f"{task}_Mtets_per_s"] = row["tets"] / row[f"{task}_s"] / 1e6
            table.add(row, {"size_MB": sum(file.stat().st_size for file in Path(folder).iterdir()) / 1e6})


def cost(task: str, name: str, path: Path, tets: float) -> Row:
    """Do one task in this process: seconds, and MB on top of what it began with."""
    mesh = cube(tets if task == "write" else 1)
    boundary_faces(mesh)  # the mesh has them by then: the named sets need them
    with spent() as used:
        if task == "write":
            FORMATS[name].write(mesh, path)
        else:
            read_mesh(path)
    row = {f"{task}_s": used["cpu_seconds"], f"{task}_MB": used["peak_MB"]}
    return row | {"tets": len(mesh.cells)} if task == "write" else row


def cube(tets: float, side: float = 60.0) -> TetMesh:
    """A cube [0, side]^3 mm of at least so many tetrahedra, with fields and sets."""
    n = int(np.ceil((tets / 6) ** (1 / 3)))
    mesh, _ = surface_nodes_first(cube_mesh(n, side))
    labels = (mesh.points[:, 2] // (side / 4)).astype(np.int32)
    fields = {"thickness": 1 + np.sin(mesh.points[:, 0]) / 3, "area": labels}
    return named_sets(replace(mesh, point_data=fields), cortex_depth=2.0, medial_wall={"area": [0]})


main = command(__doc__, read_back, formats)

if __name__ == "__main__":
    main()

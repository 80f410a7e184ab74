"""Ways to fill a surface with tetrahedra, which `cortet.stages.generate` chooses from.

These lists are the only ones; they are light, so that naming a mesher loads none.
"""

from importlib.util import find_spec

#: our own meshers: name -> how tables print it
MESHERS = {"cgal": "CGAL", "lattice": "Lattice"}
#: those of other projects, to compare with (`cortet.meshers.baselines`)
BASELINES = {"tetgen": "TetGen", "ftetwild": "fTetWild", "gmsh": "Gmsh", "netgen": "Netgen"}


def installed_backend() -> str:
    """The package that runs CGAL where the configuration says `auto`."""
    return "pygalmesh" if find_spec("pygalmesh") else "cgal"

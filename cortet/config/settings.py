"""Named settings: what they change of the defaults that stand in the sections.

`folding` makes meshes that can be folded: fine cells in the cortex, and coarse ones in the core. `cgal` takes the
paper's mesher and Gmsh, with our choices for the boundary and for S4; `published` takes all choices of the CORTET paper
(arXiv:2607.12157). A key in the configuration overrides each.
"""

from __future__ import annotations

from typing import Any

#: cells of 0.36 of the thickness of the cortex, 1.25 mm, and three times as large in the core, which does not buckle
FOLDING: dict[str, dict[str, Any]] = {"generate": {"cell_size": [0.45], "core_ratio": 3.0, "core_depth": 2.5}}

#: the paper's mesher and Gmsh: section -> key -> value
CGAL: dict[str, dict[str, Any]] = {
    "generate": {"meshers": ["cgal"]},
    "relocate": {"enabled": True},
    # its facets may be half a cell from the surface, and more at creases
    "certify": {
        "max_surface_distance": 1.0,
        "max_face_distance": 1.0,
    },
}

#: where the paper's choices differ from ours
PUBLISHED: dict[str, dict[str, Any]] = {
    "repair": {"enabled": False},
    "smooth_surface": {
        "method": "published",
        "max_area_change": 0.06,
        "max_volume_change": None,
        "max_displacement": 0.25,
    },
    "generate": {"meshers": ["cgal"], "facet_distance": [0.5], "fallback": None},
    "transfer": {"enabled": True},
    "relocate": {"enabled": True, "boundary": "free"},
    "clean": {"boundary": "free", "improve_mean": False},
    "reconnect": {"enabled": False},
    "smooth_boundary": {"iterations": 10, "onto_surface": False},
    "certify": {
        "max_boundary_distance": None,
        "max_face_distance": None,
        "min_bank_gap": None,
        "max_surface_distance": None,
        "max_mean_surface_distance": None,
        "max_area_change": None,
        "max_volume_change": None,
        "max_native_distance": None,
        "max_mean_native_distance": None,
        "max_native_area_change": None,
        "max_repaired_area": None,
        "max_repaired_volume": None,
    },
}

#: parameters of the named settings, where they differ from the defaults
SETTINGS: dict[str, dict[str, Any]] = {"folding": FOLDING, "cgal": CGAL, "published": PUBLISHED}

"""What is measured of a folding body at one moment: a row of the table that a run writes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from cortet.formats.tables import Column
from cortet.geometry.topology import enclosed_volume, face_areas
from cortet.measure.quality import quality
from cortet.mesh import FloatArray, IntArray
from cortet.simulation.folds import fold_spacing, sulcal_depth

#: columns of the table, in the order of `Measurements`
COLUMNS = (
    Column("step", "Steps taken"),
    Column("time", "Time of the simulation"),
    Column("gestational_age", "Gestational age at that time", "weeks"),
    Column("kinetic_energy", "Kinetic energy, dimensionless"),
    Column("elastic_energy", "Elastic energy, dimensionless"),
    Column("dissipated_energy", "Energy that damping has taken since the start, dimensionless"),
    Column("growth_work", "Energy that growth has brought since the start, dimensionless"),
    Column("contact_work", "Work of the contact forces since the start, dimensionless"),
    Column(
        "energy_error",
        "Kinetic, elastic and dissipated energy less the work of growth and contact, relative to both works; n/a "
        "where an element has inverted",
    ),
    Column("min_j", "Smallest determinant of the elastic deformation gradient in any step since the row before"),
    Column("inverted", "Number of tetrahedra where it is not positive"),
    Column("degenerate", "Times that a tetrahedron had a stretch below 0.1, all steps so far"),
    Column("q_max", "Largest q = 1 - sqrt(2) 6V / l_rms^3 of the deformed tetrahedra"),
    Column("gyrification_index", "Area of the surface over that of its convex hull"),
    Column(
        "fold_spacing_mm",
        "Mean distance from gyrus to gyrus: twice the area of the cortex over the length of the lines on it where mean "
        "curvature, smoothed over 1.5 mm, is zero; n/a where there are none",
        "mm",
    ),
    Column("sulcal_depth_mm", "Mean distance of the cortex from the convex hull", "mm"),
    Column("area_mm2", "Area of the surface", "mm2"),
    Column("volume_mm3", "Volume", "mm3"),
    Column("contacts", "Surface nodes in contact"),
)


@dataclass(frozen=True)
class Measurements:
    """One row of the table; `COLUMNS` says what its values mean and in which units."""

    step: int
    time: float
    gestational_age: float
    kinetic_energy: float
    elastic_energy: float
    dissipated_energy: float
    growth_work: float
    contact_work: float
    energy_error: float | None
    min_j: float
    inverted: int
    degenerate: int
    q_max: float
    gyrification_index: float
    fold_spacing_mm: float | None
    sulcal_depth_mm: float
    area_mm2: float
    volume_mm3: float
    contacts: int


def shape(points: FloatArray, cells: IntArray, faces: IntArray, wall: NDArray[np.bool_]) -> dict[str, Any]:
    """Those measurements that depend on the shape alone.

    Parameters
    ----------
    points, cells : nodes (n, 3) in mm and tetrahedra (m, 4)
    faces : triangles (k, 3) of the boundary
    wall : (n,), nodes of the medial wall, where no folds are counted
    """
    nodes, inverse = np.unique(faces, return_inverse=True)
    skin: IntArray = inverse.reshape(faces.shape).astype(np.int32)
    cortex: FloatArray = 1.0 - wall[nodes].astype(float)
    area = float(face_areas(points, faces).sum())
    return {
        "q_max": float(quality(points, cells).max()),
        "gyrification_index": area / float(ConvexHull(points[nodes]).area),
        "fold_spacing_mm": fold_spacing(points[nodes], skin, cortex),
        "sulcal_depth_mm": sulcal_depth(points[nodes], skin, cortex),
        "area_mm2": area,
        "volume_mm3": enclosed_volume(points, faces),
    }

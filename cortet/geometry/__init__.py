"""Points, triangles and tetrahedra: connectivity, intersections, closest points; nothing is judged here."""

"""Points, triangles and tetrahedra: connectivity, intersections, closest points; nothing is checked here."""

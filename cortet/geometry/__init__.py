"""Points, triangles and tetrahedra as such: connectivity, intersections, closest points; nothing is judged here."""

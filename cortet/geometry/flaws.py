"""Ways in which tetrahedra fail to fill a body, in words.

Apart from `filling`, which finds them by compiled kernels, since tables and pages need the words alone.
"""

VOIDS, OVERLAPPING = "voids", "overlapping_bodies"
#: identifier of a flaw -> what is counted, worded to follow the count: "3 tetrahedra listed twice"
WORDS = {
    "tetrahedra_with_doubled_nodes": "tetrahedra with a repeated node",
    "repeated_tetrahedra": "tetrahedra listed twice",
    "overfull_faces": "faces in more than two tetrahedra",
    "folded_faces": "folded faces, with both tetrahedra on one side",
    VOIDS: "voids inside the mesh",
    OVERLAPPING: "overlapping bodies",
    "coincident_nodes": "coincident nodes",
    "nonmanifold_edges": "boundary edges in more than two faces",
    "pinched_vertices": "pinched boundary vertices",
}

"""Ten-node tetrahedra whose midside nodes lie on the surface."""

import meshio

import cortet
from cortet.cli import main
from cortet.formats.gifti import write_surface
from cortet.phantoms import phantom

surface = phantom(24, subdivisions=4)
write_surface(surface, "surface.surf.gii")
made = cortet.mesh(surface, cell_size=3.0, ga=24, progress=False)
made.save("linear.vtu", force=True)
write_surface(made.surface, "meshed.surf.gii")
main(["quadratic", "linear.vtu", "meshed.surf.gii", "-o", "quadratic.inp", "--force"])
nodes = len(meshio.read("quadratic.inp").points)
print(f"{len(made.points):,} nodes, {nodes:,} with those in the middle of edges")

assert nodes > 6 * len(made.points)

"""One surface: a mesh, its verdict, a file for a solver, a picture."""

import cortet
from cortet.phantoms import phantom

surface = phantom(28, subdivisions=4)  # or the name of a file: "lh.white", "sub-01_hemi-L_white.surf.gii"
made = cortet.mesh(surface, cell_size=2.5, ga=28, hemi="L", progress=False)
print(made)
made.save("one_surface.inp", force=True)  # Abaqus, CalculiX; .mesh, .feb, .xdmf, .msh, .vtu, .pts for others
made.picture("one_surface.png", size=(800, 600))

assert made.certified and made.quality.max() < 0.4

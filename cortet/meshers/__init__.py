"""Ways to fill a surface with tetrahedra, which `cortet.stages.generate` chooses from."""

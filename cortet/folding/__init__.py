"""Folding of a meshed cortex by differential growth.

F = Fe Fv Fg on tetrahedra that bend, integrated explicitly (Tallinen et al., Nature Physics 2016; Wang et al. 2021, the
BrainGrowth solver). `body` makes the reference state of a mesh. `kernels` steps it in time. `contact` keeps its surface
from passing through itself. `fold` runs from one gestational age to another. `cortet.folding.fold_figures` draws it.
"""

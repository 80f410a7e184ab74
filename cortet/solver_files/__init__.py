"""A mesh on its way to a solver: named sets, fields, export, and checks of the written file."""

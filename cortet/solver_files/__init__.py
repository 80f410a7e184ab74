"""A mesh on its way to a solver: named sets, fields, export, and what is checked on the written file."""

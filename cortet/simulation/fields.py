"""Names of point data of a mesh, or columns of a sheet, that replace defaults of a fold."""

#: share of the growth; thickness of the cortex, mm; region of the law of growth
MASK_FIELD, THICKNESS_FIELD, LABEL_FIELD = "growth", "thickness", "label"

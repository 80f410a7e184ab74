"""How a record of quality counts elements. Tables read this without loading what measures."""

#: values of q above which elements are counted; a solver-ready mesh stays below the last
COUNTED_LIMITS = (0.3, 0.4, 0.5, 0.6)
HISTOGRAM_BIN_WIDTH = 0.005

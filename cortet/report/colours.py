"""Colours of figures and pages; a module of its own, since pages without figures need no Matplotlib."""

#: colours that colour-blind readers tell apart (Okabe and Ito)
COLOURS = BLUE, VERMILION, GREEN, ORANGE, PURPLE = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7"
#: of published data behind ours
GREY = "#B8B8B8"
#: of what is not in question, behind what is
LIGHT_GREY = "#E2E2E2"
#: of lines of published data, which are thin
DARK_GREY = "#8C8C8C"
#: of the regions by number, and their names
REGION_COLOURS = ("#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#F0E442")
COLOUR_NAMES = ("orange", "blue", "green", "pink", "yellow")

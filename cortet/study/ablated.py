"""The stages of the ablation, for those who want nothing else of it: rules are read at every start of Snakemake."""

from cortet.stages import STAGES

#: labels of the stages whose effect is measured -> stages that have run, what the last of them adds
ABLATED = {
    STAGES["generate"].label: ("S1-S2", "only"),
    STAGES["relocate"].label: ("S1-S3", "+ Gmsh (S3)"),
    STAGES["clean"].label: ("S1-S4", "+ cleaning (S4)"),
    STAGES["reconnect"].label: ("S1-S4+", "+ reconnection (S4+)"),
}

"""The stages of the ablation, in a light module: Snakemake reads it with the rules at every start."""

from cortet.stages import STAGES

#: label of a stage whose effect is measured -> stages that have run, what the last of them adds
ABLATED = {
    STAGES["generate"].label: ("S1-S2", "only"),
    STAGES["relocate"].label: ("S1-S3", "+ Gmsh (S3)"),
    STAGES["clean"].label: ("S1-S4", "+ cleaning (S4)"),
    STAGES["reconnect"].label: ("S1-S4+", "+ reconnection (S4+)"),
}

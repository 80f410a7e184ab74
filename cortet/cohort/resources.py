"""Memory and time of a job from the number of tetrahedra, which follows from the volume of the surface.

Each cost is a straight line that lies above all measurements: for the default line on 31 real surfaces at 0.6 mm (260
thousand to 5.4 million tetrahedra), for the others on 13 at cell sizes of 1, 0.8 and 0.6 mm (80 thousand to 1.5
million). `benchmarks/cohort.py resources` compares it with the benchmark files of any run. Time is CPU time, since it
depends least on other work of the machine.
"""

from __future__ import annotations

from dataclasses import dataclass

from cortet.meshers import MESHERS

#: resident memory of Snakemake itself, MB; in a cluster's job it runs twice beside the script
SNAKEMAKE_MB = 600
#: safety factors over the largest measurements: a job that exceeds its memory or time is killed
MEMORY_MARGIN, TIME_MARGIN = 1.25, 4.0
#: minutes that a job may wait for its file system and its interpreter
START_MINUTES = 5


@dataclass(frozen=True)
class Cost:
    """What a job takes: a constant, and an amount for every million tetrahedra."""

    #: peak resident memory of the script, MB
    megabytes: tuple[float, float]
    #: CPU time of the script, s, including the start of the interpreter
    seconds: tuple[float, float]

    def memory_mb(self, tets: float) -> float:
        """Peak resident memory, MB, for a number of tetrahedra."""
        return self.megabytes[0] + self.megabytes[1] * tets / 1e6

    def cpu_seconds(self, tets: float) -> float:
        """CPU time, s, for a number of tetrahedra."""
        return self.seconds[0] + self.seconds[1] * tets / 1e6


#: rule -> its cost; rules on surfaces do not depend on tetrahedra
COSTS = {
    "resample": Cost((700, 0), (15, 0)),
    "gate": Cost((700, 0), (22, 0)),  # repairs, too
    "smooth_surface": Cost((600, 0), (7, 0)),
    "separate": Cost((700, 0), (15, 0)),
    "generate": Cost((330, 550), (5, 370)),
    "transfer": Cost((230, 125), (2, 3)),
    "relocate": Cost((310, 260), (4, 55)),
    "clean": Cost((230, 290), (2, 7)),
    "reconnect": Cost((240, 420), (4, 9)),
    "smooth_boundary": Cost((400, 430), (4, 10)),
    "snap": Cost((400, 430), (4, 10)),
    "solver_ready": Cost((250, 450), (4, 5)),  # certifies, too
    "phantom": Cost((400, 0), (4, 0)),
    "fields": Cost((700, 0), (15, 0)),
    "phantom_inner": Cost((600, 0), (15, 0)),
    "case_page": Cost((560, 120), (5, 3)),
    "case_maps": Cost((250, 420), (5, 3)),
    "volumes": Cost((1500, 900), (20, 70)),
    "export": Cost((270, 170), (3, 5)),
    "ten_nodes": Cost((400, 1500), (4, 30)),
    "fold": Cost((500, 1200), (90, 4000)),
    "fold_figures": Cost((500, 800), (60, 120)),
    "folded_surface": Cost((500, 1500), (30, 120)),
}
#: of a rule that nobody has measured: as dear as the dearest stage
UNMEASURED = Cost((700, 900), (22, 370))
#: of S1 by our mesher; that of `COSTS` holds for the others
LATTICE = Cost((250, 520), (8, 20))

#: largest volume of one human hemisphere at any age, mL
LARGEST_HEMISPHERE_ML = 700.0


def expected_volume_ml(gestational_age: float | None, *, whole: bool = False) -> float:
    """Largest volume of a hemisphere (or of both, `whole`) at an age, weeks; used until its surface is read.

    It is a line above the available templates: 29 mL at 22 weeks, 39 at 25, 70 at 30, 87 at 33, 94 at 40. If the age is
    not known, it is the volume of an adult.
    """
    most = LARGEST_HEMISPHERE_ML if gestational_age is None else max(30 + 5.5 * (gestational_age - 22), 20)
    return (2 if whole else 1) * most


def expected_tets(volume_ml: float, cell_size: float, mesher: str) -> float:
    """Tetrahedra of a mesh by a mesher, from the volume inside its surface, mL, and the cell size, mm."""
    return MESHERS[mesher].tets_per_cube * 1000 * volume_ml / cell_size**3


def cost(rule: str, mesher: str | None = None) -> Cost:
    """Cost of a rule; that of S1 depends on the mesher."""
    return LATTICE if rule == "generate" and mesher == "lattice" else COSTS.get(rule, UNMEASURED)


def memory_to_ask_mb(measured: float, attempt: int = 1) -> int:
    """Memory that a job asks for, MB, from that which its script takes at most; each attempt doubles it."""
    return round((SNAKEMAKE_MB + MEMORY_MARGIN * measured) * 2 ** (attempt - 1))


def minutes_to_ask(cpu_seconds: float) -> int:
    """Time limit of a job, minutes."""
    return round(START_MINUTES + TIME_MARGIN * cpu_seconds / 60)

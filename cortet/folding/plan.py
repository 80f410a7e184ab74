"""What is folded in a run of the workflow: jobs, parameters and names of files; `cohort.plan` has the meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.cohort.layout import Wildcards, beside, file_of, filled
from cortet.cohort.plan import Plan
from cortet.cohort.selection import folded
from cortet.cohort.states import States
from cortet.errors import InputError
from cortet.folding.measures import surface_files, weeks_of
from cortet.meshes import OUTERMOST, region_names
from cortet.report.results import PagePart, files_of
from cortet.version import version_of

if TYPE_CHECKING:
    from cortet.report.pages import Panel


@dataclass(frozen=True)
class Folds:
    """Folds on the meshes of a plan."""

    plan: Plan

    # --- names of files ------------------------------------------------------------------------------------------

    def fold(self, name: str) -> str:
        """Pattern of a file of a simulation; a run has a folder of its own."""
        run = "{case}_res-{res}um_desc-{mesher}{setting}Folded{variant}"
        return f"{self.plan.layout.output}/{{folder}}/simulation/{run}/{name}"

    def surfaces(self, week: float | str = "{week}") -> dict[str, str]:
        """Patterns of the files of the folded cortex at a week: `surface`, and one for each measure."""
        return {name: self.fold(str(path)) for name, path in surface_files(Path(), "{case}", week).items()}

    # --- folds ---------------------------------------------------------------------------------------------------

    @cached_property
    def folded(self) -> set[str]:
        """Names of the cases whose meshes are folded."""
        asked = folded(list(self.plan.cases.values()), self.plan.config.fold.cases)
        if shelled := [case.name for case in asked if region_names(case.inner)[0] != OUTERMOST]:
            raise InputError(
                f"{', '.join(shelled)}: selected for folding, but the mesh has other regions around the brain",
                remedy="name the brain in the column surface, or do not fold the case",
            )
        return {case.name for case in asked}

    def runs(self) -> dict[str, dict[str, Any]]:
        """Requested folds: verdict file -> row of the folding table."""
        return {
            file_of(self.fold("verdict.json"), self.plan.cases[case], res, mesher, variant=variant.capitalize()): {
                "case": case,
                "variant": variant or None,
                "cell_size_mm": res / 1000,
                "mesher": mesher,
                "hemisphere": self.plan.cases[case].hemi,
            }
            for case, res, mesher in self.plan.each_case(self.plan.layout.certificate)
            for variant in ["", *self.plan.config.fold.variants]
            if case in self.folded
        }

    def job(self, run: Mapping[str, Any]) -> dict[str, str]:
        """Wildcards of the job of a row of `runs`."""
        mesh = self.plan.job((run["case"], round(1000 * run["cell_size_mm"]), run["mesher"]))
        return mesh | {"variant": (run["variant"] or "").capitalize()}

    def files(self) -> list[str]:
        """Pictures of the requested folds, and their surfaces."""
        names = ("folding.svg", "folded.png", "folding.gif")
        pictures = [str(Path(verdict).with_name(name)) for verdict in self.runs() for name in names]
        return [*pictures, *(path for some in self.surfaces_of_runs().values() for path in some.values())]

    def surfaces_of_runs(self) -> dict[tuple[str, float], dict[str, str]]:
        """Files of the folded cortex of each requested fold, by its verdict file and week."""
        return {
            (verdict, week): _beside(verdict, self.surfaces(week), run["case"])
            for verdict, run in self.runs().items()
            for week in self.weeks(run["case"], run["variant"])
        }

    def weeks(self, case: str, variant: str | None) -> list[float]:
        """The weeks of `fold.surfaces` that a fold reaches."""
        fold = self.plan.config.fold
        changed = fold.variants.get(variant or "", {})
        start, surfaces = self.plan.cases[case].scan_age, changed.get("surfaces", fold.surfaces)
        return [] if start is None else weeks_of(surfaces, start, changed.get("end", fold.end))

    def arguments(self, job: Wildcards) -> dict[str, Any]:
        """What a fold needs besides its mesh (`config.fold.Settings`)."""
        case, fold = self.plan.cases[job["case"]], self.plan.config.fold
        changed = fold.variants.get(job.get("variant", "").lower(), {})
        return {**fold.values(), "gestational_age": case.scan_age, "hemisphere": case.hemi, **changed}

    def real_surfaces(self, job: Wildcards) -> dict[str, str]:
        """The real brains that the pictures of a fold show, by their ages."""
        found = self.plan.config.fold.real_surfaces_of(self.plan.cases[job["case"]].hemi)
        return {f"{age:g}": str(path) for age, path in found.items()}

    def pictured(self, job: Wildcards) -> dict[str, list[str]]:
        """The folded surfaces and maps that the picture of a fold shows, by week, if `fold.picture` names a map."""
        measure = self.plan.config.fold.picture
        weeks = self.weeks(job["case"], job.get("variant", "").lower()) if measure else []
        return {
            f"{week:g}": [filled(self.surfaces(week)[name], job) for name in ("surface", measure) if name]
            for week in weeks
        }


def _beside(verdict: str, patterns: Mapping[str, str], case: str) -> dict[str, str]:
    """Files of a case beside its verdict, from patterns of their names."""
    return {name: str(Path(verdict).with_name(Path(one).name.format(case=case))) for name, one in patterns.items()}


def folds_on_page(states: States) -> list[PagePart]:
    """The curves of all folds and their table, if any case is folded."""
    plan = states.plan
    folds = Folds(plan)
    if not folds.folded:
        return []
    files, runs = files_of(plan, "cohort_folding", ".tsv", ".json", ".svg", ".pdf", ".png"), folds.runs()
    page = plan.layout.cohort_page

    def write() -> None:
        from cortet.folding.cohort_folding import write_cohort_folding

        whys = {path: states.why_missing(path, "fold", folds.job(run)) for path, run in runs.items()}
        there = [{**run, "folder": str(Path(path).parent)} for path, run in runs.items() if not whys[path]]
        failed = [{**run, "reason": whys[path]} for path, run in runs.items() if whys[path]]
        write_cohort_folding(there, failed, files)

    def panels() -> list[Panel]:
        from cortet.folding.cohort_folding import panel

        seen = [{**run, "folder": beside(Path(path).parent, page)} for path, run in runs.items()]
        return [panel(Path(files[0]), Path(files[2]), seen)]

    inputs = [str(Path(path).with_name(name)) for path in runs for name in ("verdict.json", "fold.tsv")]
    facts = [version_of("folding.cohort_folding"), *runs.values()]
    return [PagePart(files, inputs, facts, write, panels)]

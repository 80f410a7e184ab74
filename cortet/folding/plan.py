"""What is folded in a run of the workflow: jobs, parameters and names of files; `cohort.plan` has the meshes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cortet.cohort.jobs import Job, existing
from cortet.cohort.layout import file_of, filled
from cortet.cohort.plan import Plan
from cortet.cohort.selection import chosen
from cortet.cohort.sheet import PHANTOM, Case
from cortet.cohort.user_files import content
from cortet.errors import InputError
from cortet.folding.fields import LABEL_FIELD
from cortet.folding.measures import USUAL, surface_files, weeks_of
from cortet.meshes import OUTERMOST, region_names
from cortet.sections import Cases
from cortet.stages import STAGES

#: column of the sheet that says which cases are folded
FOLD = "fold"


@dataclass(frozen=True)
class Folds:
    """Folds on the meshes of a plan, and the experiments on convergence and prediction."""

    plan: Plan

    # --- names of files ------------------------------------------------------------------------------------------

    def fold(self, name: str) -> str:
        """Pattern of a file of a simulation; a run has a folder of its own."""
        run = "{case}_res-{res}um_desc-{mesher}{setting}Folded{variant}"
        return f"{self.plan.layout.output}/{{folder}}/simulation/{run}/{name}"

    def surfaces(self, week: float | str = "{week}") -> dict[str, str]:
        """Patterns of the files of the folded cortex at a week: `surface`, and one for each measure."""
        return {name: self.fold(str(path)) for name, path in surface_files(Path(), "{case}", week).items()}

    def convergence(self, name: str) -> str:
        """Pattern of a file of a fold of the experiment on convergence; a realisation of a mesh has its own folder."""
        run = "{case}_res-{res}um_desc-{mesher}_seed-{seed}"
        return f"{self.plan.layout.output}/{{folder}}/convergence/{run}/{name}"

    def prediction(self, name: str, changed: str = "{changed}") -> str:
        """Pattern of a file of the experiment on prediction; a series lies with its first case."""
        return f"{self.plan.layout.output}/{{folder}}/prediction/{{case}}_desc-{{kind}}{changed}/{name}"

    # --- folds ---------------------------------------------------------------------------------------------------

    @cached_property
    def folded(self) -> set[str]:
        """Names of the cases whose meshes are folded.

        Raises
        ------
        InputError
            no case has a given name, the sheet lacks a given column, a case has no age, or other regions lie around
            the brain
        """
        asked = folded(list(self.plan.cases.values()), self.plan.config.fold.cases)
        if shelled := [case.name for case in asked if region_names(case.inner)[0] != OUTERMOST]:
            raise InputError(
                f"{', '.join(shelled)}: to be folded, but other regions lie around the brain",
                remedy="give the brain as column surface, or do not fold the case",
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

    # --- the population ------------------------------------------------------------------------------------------

    def common(self, week: float | str = "{week}") -> dict[str, str]:
        """Patterns of the files of the folded cortex at a week on the common mesh, and of its means over parcels."""
        begin = f"{{case}}_week-{week if isinstance(week, str) else f'{week:g}'}_"
        names = {"surface": "space-common_white.surf.gii", "maps": "space-common_maps.shape.gii"}
        return {key: self.fold(begin + name) for key, name in {**names, "parcels": "parcels.tsv"}.items()}

    def population(self) -> dict[tuple[str, float], list[dict[str, Any]]]:
        """Folds on the common mesh by hemisphere and week: what the sheet says of each, and its files.

        Only folds for the first cell size and the first mesher count, in the order of the sheet.
        """
        found: dict[tuple[str, float], list[dict[str, Any]]] = {}
        config = self.plan.config
        for verdict, run in self.runs().items():
            case = self.plan.cases[run["case"]]
            first = round(1000 * run["cell_size_mm"]) == self.plan.resolutions_of(case)[0]
            if not (
                first and run["mesher"] == config.generate.meshers[0] and self.plan.is_resampled({"case": case.name})
            ):
                continue
            for week in self.weeks(case.name, run["variant"]):
                row = {
                    "case": case.name,
                    "variant": run["variant"] or USUAL,
                    "hemi": case.hemi,
                    "week": week,
                    "scan_age": case.scan_age,
                    **case.extra,
                }
                found.setdefault((case.hemi or "LR", week), []).append(
                    {**row, "files": _beside(verdict, self.common(week), case.name)}
                )
        return dict(sorted(found.items()))

    def population_files(self, hemi: str, week: float) -> dict[str, str]:
        """Files of all folds of a hemisphere at a week."""
        chosen, cohort, begin = self.plan.config.biomarkers, self.plan.layout.cohort, f"hemi-{hemi}_week-{week:g}"
        ends = {"order": ".tsv", "surface": "_white.surf.gii"}
        ends |= {"design": "_design.mat", "contrasts": "_design.con"} if chosen.model else {}
        for name in chosen.measures:
            plain = name.replace("_", "")
            ends |= {f"{name}_stack": f"_{plain}.func.gii", f"{name}_maps": f"_{plain}.shape.gii"}
        named = {name: cohort(f"biomarkers/{begin}{end}") for name, end in ends.items()}
        return {**named, "figure": cohort(f"figure-biomarkers_{begin}.png")}

    def parcels(self, job: Job) -> str | list[str]:
        """The file with the parcels of a case; empty if none are asked for, or the case has none."""
        name = self.plan.config.biomarkers.parcels
        return existing(self.plan.case(job).fields.get(name)) if name else []

    def weeks(self, case: str, variant: str | None) -> list[float]:
        """The weeks of `fold.surfaces` that a fold reaches."""
        fold = self.plan.config.fold
        changed = fold.variants.get(variant or "", {})
        start, surfaces = self.plan.cases[case].scan_age, changed.get("surfaces", fold.surfaces)
        return [] if start is None else weeks_of(surfaces, start, changed.get("end", fold.end))

    def variant(self, job: Job) -> dict[str, Any]:
        """Parameters by which a variant differs from the other folds of its case."""
        return self.plan.config.fold.variants.get(job.get("variant", "").lower(), {})

    def real_surfaces(self, job: Job) -> dict[str, str]:
        """The real brains that the pictures of a fold show, by their ages."""
        found = self.plan.config.fold.real_surfaces_of(self.plan.case(job).hemi)
        return {f"{age:g}": str(path) for age, path in found.items()}

    def pictured(self, job: Job) -> dict[str, list[str]]:
        """The folded surfaces and maps that the picture of a fold shows, by week, if `fold.picture` names a map."""
        measure = self.plan.config.fold.picture
        weeks = self.weeks(job["case"], job.get("variant", "").lower()) if measure else []
        return {
            f"{week:g}": [filled(self.surfaces(week)[name], job) for name in ("surface", measure) if name]
            for week in weeks
        }

    # --- convergence ---------------------------------------------------------------------------------------------

    def realisation(self, job: Mapping[str, Any]) -> dict[str, Any]:
        """Configuration of the line that makes a realisation of a mesh, with what the sheet says of the case."""
        config, case = self.plan.config, self.plan.cases[job["case"]]
        own = {
            "generate": {
                "cell_size": [int(job["res"]) / 1000],
                "meshers": [job["mesher"]],
                "seed": int(job["seed"]),
            },
            "gate": {
                "unit": case.unit or config.gate.unit,
                "affine": str(case.affine) if case.affine else config.gate.affine,
            },
            "resample": {"template": config.resample.template_of(case.hemi)},
        }
        sections = {name: getattr(config, name, None) for name in (*STAGES, "regions", "certify")}
        return {
            "setting": config.setting,
            **{
                name: section.model_dump(mode="json") | own.get(name, {})
                for name, section in sections.items()
                if section is not None
            },
        }

    def convergence_files(self) -> list[str]:
        """Records and surfaces of all folds of the experiment on convergence."""
        experiment, cases = self.plan.config.experiments.convergence, self.plan.cases.values()
        return [
            self.convergence(name).format(
                folder=case.folder, case=case.name, res=round(1000 * size), mesher=mesher, seed=seed
            )
            for case in folded([case for case in cases if not case.inner], experiment.cases)
            for size in experiment.cell_size
            for mesher in experiment.meshers
            for seed in experiment.seeds
            for name in ("record.json", "fold.tsv", "start.surf.gii", "folded.surf.gii")
        ]

    # --- prediction ----------------------------------------------------------------------------------------------

    def prediction_series(self) -> dict[str, dict[float, Case]]:
        """Cases of one participant and hemisphere at several ages, by their ages: first case -> age -> case."""
        wanted = self.plan.config.experiments.prediction.participants
        found: dict[tuple[str, str | None], dict[float, Case]] = {}
        for case in self.plan.cases.values():
            if case.scan_age is not None and not case.inner and (not wanted or case.participant in wanted):
                found.setdefault((case.participant, case.hemi), {}).setdefault(case.scan_age, case)
        several = [dict(sorted(cases.items())) for cases in found.values() if len(cases) > 1]
        return {next(iter(cases.values())).name: cases for cases in several}

    def surfaces_of_series(self, first: str) -> list[str]:
        """Surfaces of the series that begins with a case, by age, as they are given; those that exist.

        Raises
        ------
        InputError : another case has the age of one of them
        """
        series = self.prediction_series()[first].values()
        for case, other in itertools.product(series, self.plan.cases.values()):
            same = (case.participant, case.hemi, case.scan_age) == (other.participant, other.hemi, other.scan_age)
            if same and other.name != case.name and not other.inner:
                raise InputError(
                    f"{case.name} and {other.name} have the same age, {case.scan_age:g} weeks, in one series",
                    remedy="set the column include of one of them to false, or mend its scan_age",
                )
        return [
            filled(path, {"folder": case.folder, "case": case.name})
            for case in series
            if isinstance(path := self.plan.surface({"case": case.name}), str)
        ]

    def spheres_of_series(self, first: str) -> list[str]:
        """Registered spheres of the series that begins with a case, by age; none if one of its cases has none."""
        cases = list(self.prediction_series()[first].values())
        paths = [
            self.plan.layout.surface("phantom", "sphere.surf.gii") if case.sphere == PHANTOM else existing(case.sphere)
            for case in cases
            if case.sphere is not None
        ]
        return [
            filled(path, {"folder": case.folder, "case": case.name})
            for case, path in zip(cases, paths, strict=False)
            if isinstance(path, str) and len(paths) == len(cases)
        ]

    def labels_of_series(self, first: str) -> str | None:
        """File with the lobe, or another label, of each vertex of the first surface of a series, if it has one."""
        file = self.plan.cases[first].fields.get(LABEL_FIELD)
        return None if file is None else str(file)

    def series_sha256(self, job: Job) -> dict[str, str | None]:
        """Hashes of the user's files of a series, in their order."""
        first, output = job["case"], Path(self.plan.layout.output).absolute()
        paths = [*self.surfaces_of_series(first), *self.spheres_of_series(first), self.labels_of_series(first)]
        own = [path for path in paths if path and not Path(path).absolute().is_relative_to(output)]
        return content({str(number): path for number, path in enumerate(own)})

    def predictions(self, kinds: Iterable[str]) -> Iterator[Job]:
        """Series and kinds that are predicted, of some kinds."""
        for case in self.prediction_series():
            for kind in kinds:
                if kind != "shuffled" or self.spheres_of_series(case):
                    yield {"folder": self.plan.cases[case].folder, "case": case, "kind": kind}

    def prediction_files(self, name: str) -> list[str]:
        """A file of each prediction, without those under variants."""
        pattern = self.prediction(name, changed="")
        return [pattern.format(**job) for job in self.predictions(self.plan.config.experiments.prediction.kinds)]

    def prediction_spreads(self) -> list[str]:
        """Records of how far predictions under the variants lie apart."""
        pattern = self.prediction("spread.json", changed="")
        return [pattern.format(**job) for job in self.predictions(self.plan.config.experiments.prediction.uncertain)]

    def varied_predictions(self, job: Job) -> list[str]:
        """Records of a prediction, and of the same under each of the variants."""
        names = ["", *(name.capitalize() for name in self.plan.config.experiments.prediction.variants)]
        return [self.prediction("record.json").format(**{**job, "changed": name}) for name in names]

    def changed(self, job: Job) -> dict[str, Any]:
        """What a variant changes of a prediction: cell_size, seed, and keys of fold."""
        return self.plan.config.experiments.prediction.variants.get(job["changed"].lower(), {})

    def predicted_realisation(self, job: Mapping[str, Any]) -> dict[str, Any]:
        """The realisation that a prediction begins with, under its variant."""
        changed = self.changed(job)
        size = changed.get("cell_size", self.plan.config.experiments.prediction.cell_size)
        seed = changed.get("seed", self.plan.config.generate.seed)
        return self.realisation(
            {
                "case": job["case"],
                "res": round(1000 * size),
                "mesher": self.plan.config.generate.meshers[0],
                "seed": seed,
            }
        )


def folded(cases: Sequence[Case], which: Cases | None) -> list[Case]:
    """The cases that are folded: the configuration chooses them, or else the column `fold` if there is one.

    A fold starts at an age, so cases without an age are skipped unless they are asked for by name or column.

    Raises
    ------
    InputError : as `chosen`; or a case that is asked for has no age
    """
    if which is None:
        which = {"column": FOLD} if any(FOLD in case.extra for case in cases) else []
    if isinstance(which, (str, int)):
        return chosen([case for case in cases if case.scan_age is not None], which)
    asked = chosen(cases, which)
    if ageless := [case.name for case in asked if case.scan_age is None]:
        raise InputError(
            f"{', '.join(ageless)}: to be folded, but without an age, at which the fold would start",
            remedy="give the age in column scan_age of the cohort sheet, gestational weeks, or do not fold the case",
        )
    return asked


def _beside(verdict: str, patterns: Mapping[str, str], case: str) -> dict[str, str]:
    """Files of a case beside its verdict, from patterns of their names."""
    return {name: str(Path(verdict).with_name(Path(one).name.format(case=case))) for name, one in patterns.items()}

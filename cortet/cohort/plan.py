"""What a run of the workflow does: the inputs and parameters of each job, and the files that are requested.

The rules ask a `Plan` and hold no logic of their own.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cortet.cohort.jobs import Job, Jobs, Mesh, existing
from cortet.cohort.layout import EXPORTED, beside, file_of, filled
from cortet.cohort.receipts import content
from cortet.cohort.selection import folded
from cortet.cohort.sheet import PHANTOM, Case
from cortet.errors import InputError
from cortet.meshes import OUTERMOST, region_names
from cortet.simulation.fields import LABEL_FIELD

__all__ = ["AFTER_CERTIFICATE", "OVER_ALL_CASES", "Plan", "existing"]

#: rules that read all finished meshes
OVER_ALL_CASES = (
    *("cohort_quality", "cohort_summary", "cohort_stages", "cohort_figure", "cohort_status", "cohort_page", "citation"),
    *("cohort_maps", "cohort_tissues"),
    *("cohort_folding", "convergence", "prediction"),
    *("table_ablation", "table_resolution", "table_measures", "figure_pooled_quality", "figure_series", "methods"),
)
#: rules after the certificate: the mesh is measured even if they fail
AFTER_CERTIFICATE = (
    *("volumes", "export", "ten_nodes", "case_page", "case_maps"),
    *("fold", "fold_figures", "convergence_run", "prediction_run", "prediction_views", "prediction_spread"),
)


@dataclass(frozen=True)
class Plan(Jobs):
    """A whole run: its jobs, its folds, its failures, and the files over all cases."""

    def notices(self) -> list[str]:
        """What a user should know of these cases before they run, in plain words."""
        if not self.config.export.holes:
            return []
        from cortet.solver_files.holes import regions_of

        names = sorted({name for case in self.sheet for name in case.inner})
        absent = [hole for hole in self.config.export.holes if not regions_of(hole, names)]
        known = f"they have {', '.join(names)}" if names else "they have none"
        return [f"export.holes: no case has an inner surface {hole}, {known}" for hole in absent]

    # --- folding -------------------------------------------------------------------------------------------------

    @cached_property
    def folded(self) -> set[str]:
        """Names of the cases whose meshes are folded.

        Raises
        ------
        InputError
            no case has a given name, the sheet lacks a given column, a case has no age, or other regions lie around
            the brain
        """
        asked = folded(list(self.cases.values()), self.config.fold.cases)
        if shelled := [case.name for case in asked if region_names(case.inner)[0] != OUTERMOST]:
            raise InputError(
                f"{', '.join(shelled)}: to be folded, but other regions lie around the brain",
                remedy="give the brain as column surface, or do not fold the case",
            )
        return {case.name for case in asked}

    def fold_runs(self) -> dict[str, dict[str, Any]]:
        """Requested folds: verdict file -> row of the folding table."""
        return {
            file_of(self.layout.fold("verdict.json"), self.cases[case], res, mesher, variant=variant.capitalize()): {
                "case": case,
                "variant": variant or None,
                "cell_size_mm": res / 1000,
                "mesher": mesher,
                "hemisphere": self.cases[case].hemi,
            }
            for case, res, mesher in self.each_case(self.layout.certificate)
            for variant in ["", *self.config.fold.variants]
            if case in self.folded
        }

    def fold_files(self) -> list[str]:
        """Pictures of the requested folds."""
        names = ("folding.svg", "folded.png", "folding.gif")
        return [str(Path(verdict).with_name(name)) for verdict in self.fold_runs() for name in names]

    def variant(self, job: Job) -> dict[str, Any]:
        """Parameters by which a variant differs from the other folds of its case."""
        return self.config.fold.variants.get(job.get("variant", "").lower(), {})

    def prediction_series(self) -> dict[str, dict[float, Case]]:
        """Cases of one participant and hemisphere at several ages, by their ages: first case -> age -> case."""
        wanted = self.config.experiments.prediction.participants
        found: dict[tuple[str, str | None], dict[float, Case]] = {}
        for case in self.cases.values():
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
        for case, other in itertools.product(series, self.cases.values()):
            same = (case.participant, case.hemi, case.scan_age) == (other.participant, other.hemi, other.scan_age)
            if same and other.name != case.name and not other.inner:
                raise InputError(
                    f"{case.name} and {other.name} have the same age, {case.scan_age:g} weeks, in one series",
                    remedy="set the column include of one of them to false, or mend its scan_age",
                )
        return [
            filled(path, {"folder": case.folder, "case": case.name})
            for case in series
            if isinstance(path := self.surface({"case": case.name}), str)
        ]

    def spheres_of_series(self, first: str) -> list[str]:
        """Registered spheres of the series that begins with a case, by age; none if one of its cases has none."""
        cases = list(self.prediction_series()[first].values())
        paths = [
            self.layout.surface("phantom", "sphere.surf.gii") if case.sphere == PHANTOM else existing(case.sphere)
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
        file = self.cases[first].fields.get(LABEL_FIELD)
        return None if file is None else str(file)

    def series_sha256(self, job: Job) -> dict[str, str | None]:
        """Hashes of the user's files of a series, in their order."""
        first, output = job["case"], Path(self.layout.output).absolute()
        paths = [*self.surfaces_of_series(first), *self.spheres_of_series(first), self.labels_of_series(first)]
        own = [path for path in paths if path and not Path(path).absolute().is_relative_to(output)]
        return content({str(number): path for number, path in enumerate(own)})

    def predictions(self, kinds: Iterable[str]) -> Iterator[Job]:
        """Series and kinds that are predicted, of some kinds."""
        for case in self.prediction_series():
            for kind in kinds:
                if kind != "shuffled" or self.spheres_of_series(case):
                    yield {"folder": self.cases[case].folder, "case": case, "kind": kind}

    def prediction_files(self, name: str) -> list[str]:
        """A file of each prediction, without those under variants."""
        pattern = self.layout.prediction(name, changed="")
        return [pattern.format(**job) for job in self.predictions(self.config.experiments.prediction.kinds)]

    def prediction_spreads(self) -> list[str]:
        """Records of how far predictions under the variants lie apart."""
        pattern = self.layout.prediction("spread.json", changed="")
        return [pattern.format(**job) for job in self.predictions(self.config.experiments.prediction.uncertain)]

    def varied_predictions(self, job: Job) -> list[str]:
        """Records of a prediction, and of the same under each of the variants."""
        names = ["", *(name.capitalize() for name in self.config.experiments.prediction.variants)]
        return [self.layout.prediction("record.json").format(**{**job, "changed": name}) for name in names]

    def changed(self, job: Job) -> dict[str, Any]:
        """What a variant changes of a prediction: cell_size, seed, and keys of fold."""
        return self.config.experiments.prediction.variants.get(job["changed"].lower(), {})

    def real_surfaces(self, job: Job) -> dict[str, str]:
        """The real brains that the pictures of a fold show, by their ages."""
        found = self.config.fold.real_surfaces_of(self.hemisphere(job))
        return {f"{age:g}": str(path) for age, path in found.items()}

    def gpus(self, job: Job) -> int:
        """GPUs that a fold asks for."""
        return int(self.variant(job).get("device", self.config.fold.device) == "cuda")

    # --- what failed, and what is over all cases -----------------------------------------------------------------

    def is_measured(self, mesh: Mesh) -> bool:
        """Whether a mesh has its certificate: it did not fail, or only after the certificate."""
        return mesh not in self.failures or self.failures[mesh]["stage"] in AFTER_CERTIFICATE

    def job(self, mesh: Mesh) -> dict[str, str]:
        """Wildcards of the jobs on a mesh of the line."""
        case, res, mesher = mesh
        return {"folder": self.cases[case].folder, "case": case, "res": str(res), "mesher": mesher, "setting": ""}

    def unmeasured(self) -> dict[str, str]:
        """Why cases have no certificate, by their names."""
        return {mesh[0]: failure["reason"] for mesh, failure in self.failures.items() if not self.is_measured(mesh)}

    def measured_certificates(self) -> list[str]:
        """Certificates of all meshes that have one."""
        return [path for mesh, path in self.each_case(self.layout.certificate).items() if self.is_measured(mesh)]

    def stage_records(self) -> list[str]:
        """Quality records, stage by stage, of the meshes that have a certificate."""
        records = [self.each_case(self.layout.mesh(label, "quality.json")) for label in self.measured_stages()]
        meshes = filter(self.is_measured, self.each_case(self.layout.certificate))
        return [record[mesh] for mesh in meshes for record in records]

    def exported_files(self) -> list[str]:
        """Files for solvers of the meshes that did not fail."""
        patterns = self.layout.solver_files(self.config.export.formats, self.config.export.ten_nodes)
        return [
            path for pattern in patterns for mesh, path in self.each_case(pattern).items() if mesh not in self.failures
        ]

    def exported(self, job: Job) -> dict[str, Any]:
        """Names and formats of a mesh's files for solvers, and whether a mesh that is not certified has them."""
        files = [
            (Path(filled(self.layout.mesh("Solver", suffix), job)).name, name)
            for suffix, name in EXPORTED.items()
            if name in self.config.export.formats
        ]
        for name in self.config.export.ten_nodes:
            pattern, _ = self.layout.ten_node_files([name])
            files.append((Path(filled(pattern, job)).name, f"{name}, ten nodes"))
        return {"names": files, "uncertified": self.config.export.uncertified}

    @property
    def has_volumes(self) -> bool:
        """Whether any case has volumes."""
        return any(case.volumes for case in self.cases.values())

    def tissue_tables(self) -> dict[Mesh, str]:
        """Tables of the tissue in the meshes of cases with volumes."""
        return {
            mesh: path
            for mesh, path in self.each_case(self.layout.mesh("Solver", "volumes.tsv")).items()
            if self.cases[mesh[0]].volumes
            and self.is_measured(mesh)
            and self.failures.get(mesh, {}).get("stage") != "volumes"
        }

    def described(self, mesh: Mesh) -> dict[str, Any]:
        """Case, age, cell size and mesher of a mesh."""
        case, res, mesher = mesh
        return {"case": case, "scan_age": self.cases[case].scan_age, "cell_size_mm": res / 1000, "mesher": mesher}

    def mapped(self, hemi: str) -> list[str]:
        """Cases of a hemisphere that are resampled onto the common mesh."""
        resamples = self.config.enabled("resample")
        return [name for name, case in self.cases.items() if case.hemi == hemi and resamples and case.sphere]

    def maps(self, hemi: str) -> dict[str, str]:
        """Maps of the finished cases of a hemisphere, by case, for the first cell size and the first mesher."""
        files = self.each_case(self.layout.mesh("Solver", "maps.surf.gii"))
        meshes = [
            (name, self.resolutions_of(self.cases[name])[0], self.config.generate.meshers[0])
            for name in self.mapped(hemi)
        ]
        made = (mesh for mesh in meshes if self.failures.get(mesh, {}).get("stage") != "case_maps")
        return {mesh[0]: files[mesh] for mesh in made if self.is_measured(mesh)}

    def mapped_hemispheres(self) -> list[str]:
        """Hemispheres that have maps."""
        return [hemi for hemi in "LR" if self.maps(hemi)]

    def about(self, job: Job) -> dict[str, Any]:
        """The facts at the top of the page of a mesh."""
        case = self.case(job)
        return {
            "surface": self.kind_of_surface(job),
            "scan_age": case.scan_age,
            "hemi": case.hemi,
            "cell_size": int(job["res"]) / 1000,
            "mesher": job["mesher"],
        }

    def thumbnails(self) -> dict[Mesh, str]:
        """The small pictures that the page of all cases shows, by mesh; those whose page failed have none."""
        every = self.each_case(self.layout.thumbnail)
        return {mesh: file for mesh, file in every.items() if self.failures.get(mesh, {}).get("stage") != "case_page"}

    def listed_on_page(self) -> list[dict[str, Any]]:
        """The meshes that the page of all cases lists."""
        thumbnails = self.thumbnails()
        return [
            {
                "case": case,
                "scan_age": self.cases[case].scan_age,
                "hemi": self.cases[case].hemi,
                "cell_size_mm": res / 1000,
                "mesher": mesher,
                "page": beside(page, self.layout.cohort_page),
                "pictured": (case, res, mesher) in thumbnails,
            }
            for (case, res, mesher), page in self.each_case(self.layout.case_page).items()
        ]

    def status(self) -> list[dict[str, Any]]:
        """Parameter of the status table: excluded rows, failures, and the certificates of the other meshes."""
        meshes = [
            {
                "case": name,
                "cell_size_mm": res / 1000,
                "mesher": mesher,
                **{key: of[key] for key in ("stage", "state", "reason", "log") if key in of},
                **({"certificate": certificate} if self.is_measured((name, res, mesher)) else {}),
            }
            for (name, res, mesher), certificate in self.each_case(self.layout.certificate).items()
            for of in [self.failures.get((name, res, mesher), {})]
        ]
        excluded = [case for case in self.sheet if not case.include]
        return meshes + [{"case": case.name, "state": "excluded", "reason": case.exclude_reason} for case in excluded]

"""What a run of the workflow does: the inputs and parameters of each job, and the files that are requested.

The rules ask a `Plan` and hold no logic of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.cohort.jobs import Job, Jobs, Mesh, existing
from cortet.cohort.layout import EXPORTED, beside, filled
from cortet.cohort.selection import ageless_notice
from cortet.formats.ownership import changed_of, files_of
from cortet.stages import stages_of

__all__ = ["AFTER_CERTIFICATE", "Plan", "existing"]

#: rules after the certificate: the mesh is measured even if they fail
AFTER_CERTIFICATE = (
    *("volumes", "export", "ten_nodes", "case_page", "case_maps"),
    *("fold", "fold_figures", "folded_surface"),
)


@dataclass(frozen=True)
class Plan(Jobs):
    """A whole run: its jobs, its failures, and the files over all cases."""

    def notices(self) -> list[str]:
        """What a user should know of these cases before they run, in plain words."""
        return [*self._absent_holes(), *self._ageless()]

    def _ageless(self) -> list[str]:
        """What is not done with the cases of unknown age; those that are to be folded by name need one."""
        asked = self.config.fold.cases
        smoothed = stages_of(self.config) != stages_of(self.config, aged=False)
        return ageless_notice([*self.cases.values()], smoothed=smoothed, folded=isinstance(asked, (str, int)))

    def _absent_holes(self) -> list[str]:
        """Holes that are asked for and that no case has."""
        if not self.config.export.holes:
            return []
        from cortet.solver_files.holes import regions_of

        names = sorted({name for case in self.sheet for name in case.inner})
        absent = [hole for hole in self.config.export.holes if not regions_of(hole, names)]
        known = f"they have {', '.join(names)}" if names else "they have none"
        return [f"export.holes: no case has an inner surface {hole}, {known}" for hole in absent]

    def edited_exports(self) -> list[str]:
        """What was changed or deleted of the files for solvers since cortet wrote them, in sentences."""
        again = "is made again when it is deleted"
        told = []
        for mesh in self.solver_files():
            record = Path(f"{mesh}.json")
            gone = [name for name in files_of(record) if not (record.parent / name).is_file()]
            told += [f"{record.parent / name} is gone: {mesh}, to which it belongs, {again}" for name in gone]
            told += (
                [] if gone else [f"{file} was changed after cortet wrote it: it {again}" for file in changed_of(record)]
            )
        return told

    # --- what failed, and what is over all cases -----------------------------------------------------------------

    def is_measured(self, mesh: Mesh) -> bool:
        """Whether a mesh has its certificate: it did not fail, or only after the certificate."""
        return mesh not in self.failures or self.failures[mesh]["stage"] in AFTER_CERTIFICATE

    def job(self, mesh: Mesh) -> dict[str, str]:
        """Wildcards of the jobs on a mesh of the line."""
        case, res, mesher = mesh
        return {"folder": self.cases[case].folder, "case": case, "res": str(res), "mesher": mesher, "setting": ""}

    def unmeasured(self) -> dict[str, str]:
        """Why cases have no certificate, by their names, without what to do about it."""
        return {
            mesh[0]: failure.get("problem") or failure["reason"]
            for mesh, failure in self.failures.items()
            if not self.is_measured(mesh)
        }

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
        """Maps of the finished, chosen cases of a hemisphere, by case, for the first cell size and the first mesher.

        While a run is planned, these are the maps that it makes; afterwards, those that exist.
        """
        files = self.each_case(self.layout.mesh("Solver", "maps.surf.gii"))
        meshes = [
            (name, self.resolutions_of(self.cases[name])[0], self.config.generate.meshers[0])
            for name in self.mapped(hemi)
        ]
        made = {mesh[0]: files[mesh] for mesh in meshes if mesh in files and self.is_measured(mesh)}
        return {case: path for case, path in made.items() if self.failed is None or Path(path).exists()}

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

    def listed_on_page(self) -> list[dict[str, Any]]:
        """The meshes that the page of all cases lists."""
        return [
            {
                "case": case,
                "scan_age": self.cases[case].scan_age,
                "hemi": self.cases[case].hemi,
                "cell_size_mm": res / 1000,
                "mesher": mesher,
                "page": beside(page, self.layout.cohort_page),
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
                **{key: of[key] for key in ("stage", "state", "reason", "log", "earlier") if key in of},
                **({"certificate": certificate} if self.is_measured((name, res, mesher)) else {}),
            }
            for (name, res, mesher), certificate in self.each_case(self.layout.certificate).items()
            for of in [self.failures.get((name, res, mesher), {})]
        ]
        excluded = [case for case in self.sheet if not case.include]
        return meshes + [{"case": case.name, "state": "excluded", "reason": case.exclude_reason} for case in excluded]

    def files_of_cases(self) -> list[str]:
        """All files of single cases that a whole run makes, without those of folds."""
        return [
            *self.solver_files(),
            *self.quality_records(),
            *self.each_case(self.layout.case_page).values(),
            *(path for hemi in "LR" for path in self.maps(hemi).values()),
        ]

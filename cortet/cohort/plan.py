"""What a run of the workflow does: the inputs and parameters of each job, and the files that are requested.

The rules ask a `Plan` and hold no logic of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.cohort.jobs import Job, Jobs, Mesh
from cortet.cohort.layout import EXPORTED, beside, filled
from cortet.cohort.selection import ageless_notice
from cortet.formats.ownership import changed_of, files_of
from cortet.stages import stages_of

#: rules after the certificate: the mesh is measured even if they fail
AFTER_CERTIFICATE = (
    *("volumes", "export", "ten_nodes", "case_page", "case_maps"),
    *("fold", "fold_figures", "folded_surface"),
)


@dataclass(frozen=True)
class Plan(Jobs):
    """A whole run: its jobs, its failures, and the files over all cases."""

    def notices(self) -> list[str]:
        """What is not done with the cases of unknown age, in plain words; those to be folded by name need one."""
        asked = self.config.fold.cases
        smoothed = stages_of(self.config) != stages_of(self.config, aged=False)
        return ageless_notice([*self.cases.values()], smoothed=smoothed, folded=isinstance(asked, (str, int)))

    def edited_exports(self) -> list[str]:
        """What was changed or deleted of the files for solvers since cortet wrote them, in sentences."""
        told = []
        for file in (path for mesh in self.meshes() for path in self.exports(mesh) if path.is_file()):
            record = Path(f"{file}.json")
            gone = [name for name in files_of(record) if not (record.parent / name).is_file()]
            told += [f"{record.parent / name} is missing: delete {file} and cortet remakes both" for name in gone]
            changed = [] if gone else changed_of(record)
            told += [f"{path} was changed after cortet wrote it: delete it and cortet remakes it" for path in changed]
        return told

    # --- what failed, and what is over all cases -----------------------------------------------------------------

    def is_measured(self, mesh: Mesh) -> bool:
        """Whether a mesh has its certificate: it did not fail, or only after the certificate."""
        return mesh not in self.failures or self.failures[mesh]["stage"] in AFTER_CERTIFICATE

    def measured(self) -> list[Mesh]:
        """The meshes that have their certificate."""
        return [*filter(self.is_measured, self.meshes())]

    def unmeasured(self) -> dict[str, str]:
        """Why cases have no certificate, by their names, without what to do about it."""
        return {mesh[0]: failure["reason"] for mesh, failure in self.failures.items() if not self.is_measured(mesh)}

    def measured_certificates(self) -> list[str]:
        """Certificates of all meshes that have one."""
        return [self.file(self.layout.certificate, mesh) for mesh in self.measured()]

    def stage_records(self) -> list[str]:
        """Quality records, stage by stage, of the meshes that have a certificate."""
        patterns = [self.layout.mesh(label, "quality.json") for label in self.measured_stages()]
        return [self.file(pattern, mesh) for mesh in self.measured() for pattern in patterns]

    def exported_files(self) -> list[str]:
        """Last meshes, and files for solvers with their sidecars, of the meshes that did not fail."""
        return [path for mesh in self.meshes() if mesh not in self.failures for path in self.final_files(mesh)]

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
        meshes = [mesh for mesh in self.measured() if self.cases[mesh[0]].volumes]
        made = [mesh for mesh in meshes if self.failures.get(mesh, {}).get("stage") != "volumes"]
        return {mesh: self.file(self.layout.mesh("Solver", "volumes.tsv"), mesh) for mesh in made}

    def mapped(self, hemi: str) -> list[str]:
        """Cases of a hemisphere that are resampled onto the common mesh."""
        resamples = self.config.enabled("resample")
        return [name for name, case in self.cases.items() if case.hemi == hemi and resamples and case.sphere]

    def maps(self, hemi: str) -> dict[str, str]:
        """Maps of the finished, chosen cases of a hemisphere, by case, for the first cell size and the first mesher.

        While a run is planned, these are the maps that it makes; afterwards, those that exist.
        """
        made, measured = {}, {*self.measured()}
        for name in self.mapped(hemi):
            mesh = (name, self.resolutions_of(self.cases[name])[0], self.config.generate.meshers[0])
            path = self.file(self.layout.mesh("Solver", "maps.surf.gii"), mesh)
            if mesh in measured and (self.failed is None or Path(path).exists()):
                made[name] = path
        return made

    def page_facts(self, job: Job) -> dict[str, Any]:
        """The facts at the top of the page of a mesh."""
        case = self.case(job)
        return {
            "surface": self.kind_of_surface(job),
            "scan_age": case.scan_age,
            "hemi": case.hemi,
            "cell_size": int(job["res"]) / 1000,
            "mesher": job["mesher"],
        }

    def described(self, mesh: Mesh) -> dict[str, Any]:
        """Case, age, hemisphere, cell size and mesher of a mesh."""
        name, res, mesher = mesh
        case = self.cases[name]
        of_case = {"case": name, "scan_age": case.scan_age, "hemi": case.hemi}
        return {**of_case, "cell_size_mm": res / 1000, "mesher": mesher}

    def listed_on_page(self) -> list[dict[str, Any]]:
        """The meshes that the page of all cases lists."""
        pages = self.each_case(self.layout.case_page)
        return [self.described(mesh) | {"page": beside(page, self.layout.cohort_page)} for mesh, page in pages.items()]

    def status(self) -> list[dict[str, Any]]:
        """The columns of the status table that are known of each mesh and each excluded row.

        In addition, the path of the `certificate` of a measured mesh, and `earlier`, the folder of outdated results.
        """
        rows = []
        for mesh, certificate in self.each_case(self.layout.certificate).items():
            name, res, mesher = mesh
            row = {"case": name, "cell_size_mm": res / 1000, "mesher": mesher, **self.failures.get(mesh, {})}
            row |= {"certificate": certificate} if self.is_measured(mesh) else {}
            rows.append(row)
        excluded = [case for case in self.sheet if not case.include]
        return rows + [{"case": case.name, "state": "excluded", "reason": case.exclude_reason} for case in excluded]

    def files_of_cases(self) -> list[str]:
        """All files of single cases that a whole run makes, without those of folds."""
        return [
            *self.solver_files(),
            *self.quality_records(),
            *self.each_case(self.layout.case_page).values(),
            *(path for hemi in "LR" for path in self.maps(hemi).values()),
        ]

"""What a run says on a terminal: a line for each case that is done, and why others failed.

Snakemake tells a logger plugin of every job that starts, ends or fails; profiles/default names this one. A mesh is done
with its certificate, a fold with its verdict. On a terminal the last line shows what is running now; elsewhere a line
says so after a minute of silence. With `--verbose` all is as Snakemake says it.

Snakemake loads every logger plugin before it reads a Snakefile. So this one imports nothing of cortet: a workflow would
else run with the package that is installed, not with its own.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from logging import ERROR, WARNING, LogRecord
from pathlib import Path
from typing import Any, TextIO

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

#: rule after which a mesh is checked, and rule that folds it
_LAST, _FOLD = "certify", "fold"
#: rules after the certificate, `cortet.cohort.plan.AFTER_CERTIFICATE`: their mesh may be of an earlier run
_AFTER = {
    "volumes",
    "export",
    "ten_nodes",
    "case_page",
    "case_maps",
    "fold",
    "fold_figures",
    "folded_surface",
    "common_maps",
    "convergence_run",
    "prediction_run",
    "prediction_views",
    "prediction_spread",
}
#: what Snakemake says of a failed job, of which our own line says why
_SAID = ("RuleException", "CalledProcessError")
_COUNTED = ("At least one job did not complete", "Exiting because a job execution failed")
#: what Snakemake says when somebody stops it, and the last line of the log of a job then
_TERMINATING, _INTERRUPTED, _STOPPED = "Terminating processes on user request", "KeyboardInterrupt", "stopped by you"
#: what Snakemake says when it was asked for something else than a run
_ASKED_FOR = ("Lints for", "Congratulations", "Report created", "Unlocked", "Cleaned up", "Deleting", "Would", "Remov")
#: a live line is cut there, so that it stays one
_WIDTH = 100
#: seconds of silence after which a log file, which has no live line, gets one
_SILENCE = 60.0


@dataclass
class Progress:
    """How far a run has come, from the events of Snakemake."""

    clock: Callable[[], float] = time.monotonic
    #: meshes that are made in this run
    meshes: int = 0
    #: names of the meshes that are done or failed
    finished: set[str] = field(default_factory=set)
    #: by what became of them: certified, not certified, failed
    counts: dict[str, int] = field(default_factory=dict)
    #: jobs done and in all, and when the first one began
    jobs: tuple[int, int] = (0, 0)
    began: float | None = None
    #: job -> what is known of it
    running: dict[int, Mapping[str, Any]] = field(default_factory=dict)
    #: case -> when its first job began
    starts: dict[str, float] = field(default_factory=dict)
    #: cases with a job that failed
    failures: set[str] = field(default_factory=set)
    #: whether somebody has stopped the run
    stopped: bool = False
    #: case -> its jobs in a dry run, and how often; those over all cases under an empty name
    plan: dict[str, dict[str, int]] = field(default_factory=dict)

    def planned(self, stats: Mapping[str, int]) -> str:
        """What will be done, from the number of jobs of each rule."""
        self.meshes, self.jobs = stats.get(_LAST, 0), (0, stats.get("total", 0))
        meshes = f"{self.meshes} {'mesh' if self.meshes == 1 else 'meshes'} to make, " if self.meshes else ""
        folds = f"{stats[_FOLD]} to fold, " if stats.get(_FOLD) else ""
        return f"{meshes}{folds}{self.jobs[1]} jobs"

    def would(self, rule: str, wildcards: Mapping[str, str]) -> None:
        """A job would run."""
        jobs = self.plan.setdefault(wildcards.get("case", ""), {})
        jobs[rule] = jobs.get(rule, 0) + 1

    def would_do(self) -> Iterator[str]:
        """What would be done to each case, then over all of them."""
        for case, jobs in sorted(self.plan.items(), key=lambda item: (not item[0], item[0])):
            names = (rule if count == 1 else f"{rule} ({count})" for rule, count in jobs.items())
            yield f"  {case or 'over all cases'}: {', '.join(names)}"

    def started(self, job: int, rule: str, wildcards: Mapping[str, str], files: Mapping[str, Any]) -> None:
        """A job starts."""
        self.began = self.clock() if self.began is None else self.began
        case = mesh_name(wildcards)
        if case:
            self.starts.setdefault(wildcards["case"], self.clock())
        known = {"rule": rule, "case": case, "name": wildcards.get("case", ""), "began": self.clock()}
        self.running[job] = known | dict(files)

    def ended(self, job: int) -> str | None:
        """A job has ended well; the line of a mesh or a fold that is done with it."""
        known = self.running.pop(job, {"rule": ""})
        if known["rule"] == _LAST:
            return self._done(known)
        if known["rule"] == _FOLD:
            return self._folded(known)
        return None

    def failed(self, job: int, rule: str, log: str | None) -> str | None:
        """The line of a job that failed; none for one that was stopped."""
        known = self.running.pop(job, {"rule": rule, "case": "", "name": ""})
        self.stopped = self.stopped or reason(log) == _STOPPED
        if self.stopped:
            return None
        self.counts["failed"] = self.counts.get("failed", 0) + 1
        self.failures |= {known["name"]} - {""}
        self.finished |= {known["case"]} - {""} if rule not in _AFTER else set()
        what = f"{known['case'] or rule}  failed in {rule}: {reason(log)}"
        return f"{self._counter()}{what}" + (f"\n{' ' * len(self._counter())}more in {log}" if log else "")

    def end(self) -> str | None:
        """The last line of a run that was stopped; others end with that of the workflow."""
        if not self.stopped:
            return None
        return f"{_STOPPED} after {self.jobs[0]} of {self.jobs[1]} jobs; the same command goes on from there"

    def live(self) -> str:
        """What is running now."""
        now = [f"{one['rule']} {one['case']}".strip() for one in self.running.values()]
        done, total = self.jobs
        return f"{done}/{total} jobs{self.left()}  {', '.join(now)}"[:_WIDTH]

    def left(self) -> str:
        """The time that is left, were all jobs alike; nothing before a tenth of them is done."""
        done, total = self.jobs
        if self.began is None or done < max(total / 10, 1) or done == total:
            return ""
        seconds = (self.clock() - self.began) / done * (total - done)
        if seconds < 30 and done > total / 2:  # the first jobs of a cohort are its shortest
            return ", nearly done"
        return f", about {seconds / 60:.0f} min left" if seconds > 90 else ", about a minute left"

    def _done(self, known: Mapping[str, Any]) -> str:
        self.finished.add(known["case"])
        certificate = json.loads(Path(known["output"][0]).read_text(encoding="utf-8"))
        quality, good = certificate["quality"], certificate["certified"]
        verdict = "certified" if good else "not certified"
        self.counts[verdict] = self.counts.get(verdict, 0) + 1
        minutes = (self.clock() - self.starts.get(known["name"], self.clock())) / 60
        why = "" if good else f": {'; '.join(certificate['reasons'])}"
        numbers = f"worst q {quality['q']['max']:.3f}, {quality['tets']:,} tetrahedra, {minutes:.1f} min"
        return f"{self._counter()}{known['case']}  {verdict}, {numbers}{self.left()}{why}"

    def _folded(self, known: Mapping[str, Any]) -> str:
        verdict = json.loads(Path(known["output"][0]).read_text(encoding="utf-8"))
        minutes = (self.clock() - known["began"]) / 60
        index = f"gyrification index {verdict['gyrification_index_last']:.2f}, {minutes:.1f} min"
        return f"{self._counter()}{known['case']}  {verdict['reason']}; {index}{self.left()}"

    def _counter(self) -> str:
        return f"{len(self.finished):{len(str(self.meshes))}}/{self.meshes}  " if self.meshes else ""


def mesh_name(wildcards: Mapping[str, str]) -> str:
    """The mesh that a job is about, in words; empty for a job over all cases."""
    case, size = wildcards.get("case", ""), wildcards.get("res", "")
    mesher = f"{wildcards.get('mesher', '')}{wildcards.get('setting', '')}"
    more = [f"{int(size) / 1000:g} mm"] if size.isdigit() else []
    more += [word for word in (mesher, wildcards.get("variant", "")) if word not in ("", "lattice")]
    return f"{case} ({', '.join(more)})" if case and more else case


def reason(log: str | None) -> str:
    """Why a job failed: the last words of its log."""
    try:
        lines = Path(log or "").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return "it left no log"
    if lines[-1:] == [_INTERRUPTED]:
        return _STOPPED
    found = [line.partition(" ERROR ")[2] for line in lines if " ERROR " in line]
    return found[-1] if found else "it was killed, or ended without a word"


class LogHandler(LogHandlerBase):
    """Snakemake's logger plugin `cortet`."""

    def __post_init__(self) -> None:
        self.stream: TextIO = sys.stdout
        self._verbose = bool(self.common_settings.verbose)
        self.progress, self._live, self._last = Progress(), self.stream.isatty(), ""
        self._said_at = self.progress.clock()

    def emit(self, record: LogRecord) -> None:
        """Say what an event means, if it means anything to a user."""
        try:
            for line in [self.format(record)] if self._verbose else self._lines(record):
                self._say(line)
            if self._live and self.progress.running:
                self._show(self.progress.live())
        except Exception:  # a message must not end a run
            self.handleError(record)

    def close(self) -> None:
        """Say how it ended."""
        if self._last:
            self._show("")
        if end := self.progress.end():
            self._say(end)
            self.progress.stopped = False  # it is closed again
        super().close()

    def _lines(self, record: LogRecord) -> Iterator[str]:
        event, progress = getattr(record, "event", None), self.progress
        known = record.__dict__
        if event == LogEvent.RUN_INFO:
            if not progress.jobs[1]:
                yield progress.planned(known["stats"])
            else:  # a dry run says it again after its jobs
                yield from progress.would_do()
        elif event == LogEvent.JOB_INFO:
            rule, wildcards = known["rule_name"], dict(known["wildcards"] or {})
            if self.common_settings.dryrun:
                progress.would(rule, wildcards)
            else:
                progress.started(known["jobid"], rule, wildcards, {"output": list(known["output"])})
        elif event == LogEvent.JOB_FINISHED:
            if line := progress.ended(known["job_id"]):
                yield line
        elif event == LogEvent.JOB_ERROR:
            if line := progress.failed(known["jobid"], known["rule_name"], next(iter(known["log"] or []), None)):
                yield line
        elif event == LogEvent.PROGRESS:
            progress.jobs = (known["done"], known["total"])
            if not self._live and progress.clock() - self._said_at > _SILENCE:
                yield progress.live()
        elif record.getMessage().startswith(_TERMINATING):
            progress.stopped = True
        elif event == LogEvent.ERROR or record.levelno >= ERROR:
            if not self._was_said(record):
                yield record.getMessage()
        elif self._is_asked_for(record):
            yield record.getMessage()
        elif "Nothing to be done" in record.getMessage():
            yield "nothing to do: everything is up to date"

    @staticmethod
    def _is_asked_for(record: LogRecord) -> bool:
        """Whether a message is a notice of cortet's own rules, or the answer to an option of Snakemake."""
        own = record.levelno == WARNING and record.pathname.endswith(".smk")
        return own or record.getMessage().startswith(_ASKED_FOR)

    def _was_said(self, record: LogRecord) -> bool:
        """Whether the line on a failed job says so, or a line of the Snakefile, which begins with its case."""
        words = record.getMessage().removeprefix("WorkflowError:").lstrip()
        if getattr(record, "exception", "") in _SAID:
            return True
        over = self.progress.stopped or self.progress.counts.get("failed")
        return bool(over) and (words.startswith((*_COUNTED, *self.progress.failures)))

    def _say(self, line: str) -> None:
        if self._last:
            self._show("")
        self.stream.write(f"{line}\n")
        self.stream.flush()
        self._said_at = self.progress.clock()

    def _show(self, line: str) -> None:
        """Replace the last line of a terminal."""
        self.stream.write(f"\r{line:<{len(self._last)}}" + ("\r" if not line else ""))
        self.stream.flush()
        self._last = line

    @property
    def writes_to_stream(self) -> bool:
        """It does."""
        return True

    @property
    def writes_to_file(self) -> bool:
        """It does not; Snakemake's own log file has everything."""
        return False

    @property
    def has_filter(self) -> bool:
        """It looks at every event."""
        return not self._verbose

    @property
    def has_formatter(self) -> bool:
        """It has its own words."""
        return not self._verbose

    @property
    def needs_rulegraph(self) -> bool:
        """It does not."""
        return False

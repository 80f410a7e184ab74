"""What a run says on a terminal: a line for each mesh that is done, and why others failed.

Snakemake tells a logger plugin of every job that starts, ends or fails; profiles/default names this one. A mesh is done
with its certificate, a fold with its verdict. On a terminal the last line shows what is running now. With `--verbose`
all is as Snakemake says it.

Snakemake loads every logger plugin before it reads a Snakefile. So this one imports nothing of cortet: a workflow would
else run with the package that is installed, not with its own.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from logging import ERROR, INFO, WARNING, Handler, LogRecord
from pathlib import Path
from typing import NamedTuple

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

#: rule that certifies a mesh, rule that folds it, and rules that refuse it if it is not certified
_LAST, _FOLD, _EXPORTS = "solver_ready", "fold", ("export", "ten_nodes")
#: ends of the names of the files in which the first two say how it went
_VERDICTS = ("certificate.json", "verdict.json")
#: exception of a failed job, of which our own line says why
_OF_JOBS = ("RuleException", "CalledProcessError")
#: a live line is cut there, so that it stays one
_WIDTH = 100


class Job(NamedTuple):
    """What is known of a job that runs."""

    rule: str
    #: its mesh in words; empty for a job over all cases
    mesh: str
    output: Sequence[str]
    #: when the first job on its mesh began, or for a fold its own
    began: float


@dataclass
class Progress:
    """How far a run has come, from the events of Snakemake."""

    clock: Callable[[], float] = time.monotonic
    #: meshes that are made in this run, how many of them are certified so far, and folds that are to come
    meshes: int = 0
    certified: int = 0
    folds: int = 0
    #: jobs done and in all, and those that are running
    jobs: tuple[int, int] = (0, 0)
    running: dict[int, Job] = field(default_factory=dict)
    #: case -> when its first job began
    starts: dict[str, float] = field(default_factory=dict)
    #: meshes that are not certified: none of their files for solvers is made
    uncertified: set[str] = field(default_factory=set)
    #: whether a job failed, and whether somebody has stopped the run
    failed: bool = False
    stopped: bool = False

    def planned(self, stats: Mapping[str, int]) -> str:
        """What will be done, from the number of jobs of each rule."""
        self.meshes, self.jobs = stats.get(_LAST, 0), (0, stats["total"])
        meshes = f"{self.meshes} {'mesh' if self.meshes == 1 else 'meshes'} to make, " if self.meshes else ""
        self.folds = stats.get(_FOLD, 0)
        folds = f"{self.folds} to fold, " if self.folds else ""
        return f"{meshes}{folds}{self.jobs[1]} jobs"

    def started(self, number: int, rule: str, wildcards: Mapping[str, str], output: Sequence[str] = ()) -> str:
        """A job starts; the line of a fold, which takes long, else nothing."""
        now = self.clock()
        first = self.starts.setdefault(wildcards.get("case", ""), now)
        self.running[number] = Job(rule, mesh_name(wildcards), output, now if rule == _FOLD else first)
        return f"{mesh_name(wildcards)}  folding begins; its log says how far it is" if rule == _FOLD else ""

    def ended(self, number: int) -> str:
        """A job has ended well; the line of a mesh or a fold that is done with it, else nothing."""
        job = self.running.pop(number, None)
        if job is None or job.rule not in (_LAST, _FOLD):
            return ""
        (verdict,) = (Path(path) for path in job.output if path.endswith(_VERDICTS))
        if not verdict.exists():  # a profile may ask for `touch`, too
            return ""
        record = json.loads(verdict.read_text(encoding="utf-8"))
        if job.rule == _FOLD:
            self.folds -= 1
            told = f"{record['reason']}; gyrification index {record['gyrification_index_last']:.2f}"
            return f"{job.mesh}  {told}, {self._minutes(job)}{self.left()}"
        self.certified += record["certified"]
        told = f"{record.get('verdict', 'certified')},"  # one of an earlier version, if a profile asks for `touch`
        if not record["certified"]:
            self.uncertified.add(job.mesh)
            told = f"NOT certified: {'; '.join(record['reasons'])};"
        numbers = f"worst q {record['quality']['q']['max']:.3f}, {record['quality']['tets']:,} tetrahedra"
        done = self.certified + len(self.uncertified)
        self.meshes = max(self.meshes, done)  # what a checkpoint finds is added to the plan
        count = f"{done:{len(str(self.meshes))}}/{self.meshes}"
        return f"{count}  {job.mesh}  {told} {numbers}, {self._minutes(job)}{self.left()}"

    def failure(self, number: int, log: str) -> str:
        """The line of a job that failed; nothing for one that was stopped, or whose line was said."""
        job, why = self.running.pop(number, None), reason(log)
        self.stopped = self.stopped or why is None
        if job is None or self.stopped:
            return ""
        self.failed = True
        if job.rule in _EXPORTS and job.mesh in self.uncertified:
            return ""
        return f"failed: {job.mesh or job.rule} in {job.rule}: {why}" + (f"\n  more in {shown(log)}" if log else "")

    def ending(self) -> str:
        """The last line of a run that did not do all jobs though none failed, as after SIGINT to Snakemake alone."""
        done, total = self.jobs
        if not (self.stopped or (self.starts and done < total and not self.failed)):
            return ""
        who = "by you" if self.stopped else "though no job failed"
        return f"stopped {who} after {done} of {total} jobs; the same command goes on from there"

    def live(self) -> str:
        """What is running now."""
        done, total = self.jobs
        now = ", ".join(f"{job.rule} {job.mesh}".strip() for job in self.running.values())
        return f"{done}/{total} jobs{self.left()}  {now}"[:_WIDTH]

    def left(self) -> str:
        """The time that is left, were all jobs alike; nothing before a tenth is done, or if folds are to come."""
        done, total = self.jobs
        if self.folds > 0 or not self.starts or done < max(total / 10, 1) or done == total:
            return ""
        minutes = (self.clock() - min(self.starts.values())) / done * (total - done) / 60
        return f", about {minutes:.0f} min left" if minutes >= 1.5 else ", about a minute left"

    def _minutes(self, job: Job) -> str:
        return f"{(self.clock() - job.began) / 60:.1f} min"


def mesh_name(wildcards: Mapping[str, str]) -> str:
    """The mesh that a job is about, in words; empty for a job over all cases."""
    case, size = wildcards.get("case", ""), wildcards.get("res", "")
    mesher = f"{wildcards.get('mesher', '')}{wildcards.get('setting', '')}"
    more = [f"{int(size) / 1000:g} mm"] if size.isdigit() else []
    more += [word for word in (mesher, wildcards.get("variant", "")) if word not in ("", "lattice")]
    return f"{case} ({', '.join(more)})" if case and more else case


def reason(log: str) -> str | None:
    """Why a job failed: as it wrote beside its log; None if somebody stopped it."""
    try:
        story = json.loads(Path(log).with_suffix(".failure.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return "it left no word; see its log"
    told = str(story["reason"])
    if told == "stopped by you":
        return None
    return f"{told} ({story['remedy']})" if story.get("remedy") else told


def shown(path: str) -> str:
    """A file as the user finds it: `cortet run` works in a folder of its own, from which names begin with dots."""
    return str(Path(path).resolve()) if path.startswith("..") else path


class LogHandler(LogHandlerBase):
    """Snakemake's logger plugin `cortet`: it sees every event, and has its own words unless all is to be shown."""

    writes_to_stream = has_filter = has_formatter = True
    writes_to_file = needs_rulegraph = False

    def __post_init__(self) -> None:
        Handler.__init__(self)  # the base class of Snakemake 9.0 leaves it out
        self.has_filter = self.has_formatter = not self.common_settings.verbose
        self.stream, self.progress, self._last = sys.stdout, Progress(), ""
        #: what is said at the end; until a run starts, it may be the answer to an option of Snakemake
        self._at_end: list[str] = []
        self._runs = self._has_notes = False
        #: whether jobs are taken as done, which says nothing of their meshes; Snakemake tells a logger only here
        self._only_touches = not {"--touch", "-t"}.isdisjoint(sys.argv)
        #: case -> how many jobs of each rule it has in a dry run
        self._plan: defaultdict[str, Counter[str]] = defaultdict(Counter)

    def emit(self, record: LogRecord) -> None:
        """Say what an event means, if it means anything to a user."""
        try:
            for line in self._lines(record) if self.has_formatter else [self.format(record)]:
                self._say(line)
            if self.stream.isatty() and self.progress.running:
                self._show(self.progress.live())
        except Exception:  # a message must not end a run
            self.handleError(record)

    def close(self) -> None:
        """Say how it ended."""
        if told := self.progress.ending():
            self._at_end = [told]
        for line in self._at_end:
            self._say(line)
        self._show("")
        self.progress, self._at_end = Progress(), []  # it is closed again
        super().close()

    def _lines(self, record: LogRecord) -> Iterator[str]:
        """What to say of a record, line by line; an empty line is not said."""
        progress, known = self.progress, record.__dict__
        match known.get("event"):
            case LogEvent.WORKFLOW_STARTED:
                rest = ", but see the notes above" if self._has_notes else ": everything is up to date"
                self._runs, self._at_end = True, [f"nothing to do{rest}"]
            case LogEvent.RUN_INFO if not self._plan:
                self._at_end = []
                yield progress.planned(known["stats"])
            case LogEvent.RUN_INFO:  # of a dry run, once more after its jobs
                for case, jobs in sorted(self._plan.items(), key=lambda item: (not item[0], item[0])):
                    names = (rule if count == 1 else f"{rule} ({count})" for rule, count in jobs.items())
                    yield f"  {case or 'over all cases'}: {', '.join(names)}"
            case LogEvent.JOB_INFO if self.common_settings.dryrun:
                self._plan[(known["wildcards"] or {}).get("case", "")][known["rule_name"]] += 1
            case LogEvent.JOB_INFO:
                wildcards = dict(known["wildcards"] or {})
                line = progress.started(known["jobid"], known["rule_name"], wildcards, list(known["output"]))
                yield f"{line}: {shown(known['log'][0])}" if line and known["log"] else line
            case LogEvent.JOB_FINISHED if self._only_touches:
                progress.running.pop(known["job_id"], None)
            case LogEvent.JOB_FINISHED:
                yield progress.ended(known["job_id"])
            case LogEvent.JOB_ERROR:
                yield progress.failure(known["jobid"], next(iter(known["log"] or []), ""))
            case LogEvent.PROGRESS:
                progress.jobs = (known["done"], known["total"])
            case LogEvent.ERROR | None if record.levelno >= ERROR:
                # once jobs have failed, further errors count them, and a WorkflowError ends the run
                of_the_end = (None, "WorkflowError") if progress.failed or progress.stopped else ()
                if known.get("exception") not in (*_OF_JOBS, *of_the_end):
                    self._at_end = []
                    yield record.getMessage()
            case None if record.levelno == WARNING:
                self._has_notes = True
                yield record.getMessage()
            case None if not self._runs and record.levelno == INFO:
                self._at_end.append(record.getMessage())

    def _say(self, line: str) -> None:
        if line:
            self._show("")
            self.stream.write(f"{line}\n")
            self.stream.flush()

    def _show(self, line: str) -> None:
        """Replace the last line of a terminal."""
        if line or self._last:
            self.stream.write(f"\r{line:<{len(self._last)}}" + ("\r" if not line else ""))
            self.stream.flush()
            self._last = line

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
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from logging import ERROR, INFO, WARNING, Handler, LogRecord
from pathlib import Path
from typing import NamedTuple

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

#: rule after which a mesh is checked, and rule that folds it
_LAST, _FOLD = "certify", "fold"
#: rules after the certificate, `cortet.cohort.plan.AFTER_CERTIFICATE`: their mesh may be of an earlier run
_AFTER = {
    *("volumes", "export", "ten_nodes", "case_page", "case_maps", "fold", "fold_figures", "folded_surface"),
}
#: rules that refuse a mesh that is not certified
_EXPORTS = ("export", "ten_nodes")
#: exceptions of a failed job, of which our own line says why
_OF_JOBS = ("RuleException", "CalledProcessError")
#: what Snakemake says when somebody stops it, of which there is no event; and the last line of the log of a job then
_TERMINATING, _INTERRUPTED, _STOPPED = "Terminating processes on user request", "KeyboardInterrupt", "stopped by you"
#: part of the name of what the timers of Snakemake's queue call
_QUEUE = "JobScheduler"
#: a live line is cut there, so that it stays one
_WIDTH = 100
#: seconds of silence after which a log file, which has no live line, gets one
_SILENCE = 60.0


class Job(NamedTuple):
    """What is known of a job: its mesh in words, its case, when it began."""

    rule: str
    mesh: str
    case: str
    output: Sequence[str]
    began: float


@dataclass
class Progress:
    """How far a run has come, from the events of Snakemake."""

    clock: Callable[[], float] = time.monotonic
    #: meshes that are made in this run, and the names of those that are done or failed
    meshes: int = 0
    finished: set[str] = field(default_factory=set)
    #: jobs done and in all, and those that are running
    jobs: tuple[int, int] = (0, 0)
    running: dict[int, Job] = field(default_factory=dict)
    #: case -> when its first job began; jobs over all cases have an empty name, here and below
    starts: dict[str, float] = field(default_factory=dict)
    #: cases with a job that failed, and meshes that are not certified: none of their files for solvers is made
    failures: set[str] = field(default_factory=set)
    uncertified: set[str] = field(default_factory=set)
    #: whether somebody has stopped the run
    stopped: bool = False
    #: case -> how many jobs of each rule it has in a dry run
    plan: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def planned(self, stats: Mapping[str, int]) -> str:
        """What will be done, from the number of jobs of each rule."""
        self.meshes, self.jobs = stats.get(_LAST, 0), (0, stats["total"])
        meshes = f"{self.meshes} {'mesh' if self.meshes == 1 else 'meshes'} to make, " if self.meshes else ""
        folds = f"{stats[_FOLD]} to fold, " if stats.get(_FOLD) else ""
        return f"{meshes}{folds}{self.jobs[1]} jobs"

    def would_do(self) -> Iterator[str]:
        """What would be done to each case, then over all of them."""
        for case, jobs in sorted(self.plan.items(), key=lambda item: (not item[0], item[0])):
            names = (rule if count == 1 else f"{rule} ({count})" for rule, count in jobs.items())
            yield f"  {case or 'over all cases'}: {', '.join(names)}"

    def started(self, job: int, rule: str, wildcards: Mapping[str, str], output: Sequence[str] = ()) -> None:
        """A job starts."""
        case, now = wildcards.get("case", ""), self.clock()
        self.starts.setdefault(case, now)
        self.running[job] = Job(rule, mesh_name(wildcards), case, output, now)

    def ended(self, number: int) -> str:
        """A job has ended well; the line of a mesh or a fold that is done with it, else nothing."""
        job = self.running.pop(number, None)
        if job is None or job.rule not in (_LAST, _FOLD):
            return ""
        record = json.loads(Path(job.output[0]).read_text(encoding="utf-8"))
        if job.rule == _FOLD:
            index = f"gyrification index {record['gyrification_index_last']:.2f}"
            return f"{self._counted(job)}  {record['reason']}; {index}, {self._minutes(job.began)}{self.left()}"
        self.finished.add(job.mesh)
        verdict, why = "certified", ""
        if not record["certified"]:
            verdict, why = "not certified", f": {'; '.join(record['reasons'])}"
            self.uncertified.add(job.mesh)
        numbers = f"worst q {record['quality']['q']['max']:.3f}, {record['quality']['tets']:,} tetrahedra"
        return f"{self._counted(job)}  {verdict}, {numbers}, {self._minutes(self.starts[job.case])}{self.left()}{why}"

    def failed(self, number: int, log: str) -> str:
        """The lines of a job that failed; nothing for one that was stopped, or whose lines were said."""
        job, why = self.running.pop(number, None), reason(log)
        self.stopped = self.stopped or why == _STOPPED
        if job is None or self.stopped:
            return ""
        self.failures.add(job.case)
        if job.rule in _EXPORTS and job.mesh in self.uncertified:
            return ""
        if job.rule not in _AFTER:
            self.finished |= {job.mesh} - {""}
        where = f"\n{' ' * len(self._counter())}more in {log}" if log else ""
        return f"{self._counted(job)}  failed in {job.rule}: {why}{where}"

    def live(self) -> str:
        """What is running now."""
        now = [f"{job.rule} {job.mesh}".strip() for job in self.running.values()]
        done, total = self.jobs
        return f"{done}/{total} jobs{self.left()}  {', '.join(now)}"[:_WIDTH]

    def left(self) -> str:
        """The time that is left, were all jobs alike; nothing before a tenth of them is done."""
        done, total = self.jobs
        if not self.starts or done < max(total / 10, 1) or done == total:
            return ""
        seconds = (self.clock() - min(self.starts.values())) / done * (total - done)
        if seconds < 30 and done > total / 2:  # the first jobs of a cohort are its shortest
            return ", nearly done"
        return f", about {seconds / 60:.0f} min left" if seconds > 90 else ", about a minute left"

    def _minutes(self, began: float) -> str:
        return f"{(self.clock() - began) / 60:.1f} min"

    def _counter(self) -> str:
        return f"{len(self.finished):{len(str(self.meshes))}}/{self.meshes}  " if self.meshes else ""

    def _counted(self, job: Job) -> str:
        return f"{self._counter()}{job.mesh or job.rule}"


def mesh_name(wildcards: Mapping[str, str]) -> str:
    """The mesh that a job is about, in words; empty for a job over all cases."""
    case, size = wildcards.get("case", ""), wildcards.get("res", "")
    mesher = f"{wildcards.get('mesher', '')}{wildcards.get('setting', '')}"
    more = [f"{int(size) / 1000:g} mm"] if size.isdigit() else []
    more += [word for word in (mesher, wildcards.get("variant", "")) if word not in ("", "lattice")]
    return f"{case} ({', '.join(more)})" if case and more else case


def reason(log: str) -> str:
    """Why a job failed: the last words of its log."""
    try:
        lines = Path(log).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return "it left no log"
    if lines[-1:] == [_INTERRUPTED]:
        return _STOPPED
    found = [line.partition(" ERROR ")[2] for line in lines if " ERROR " in line]
    return found[-1] if found else "it was killed, or ended without a word"


def end_older_timers() -> None:
    """End all timers of Snakemake's queue but the last.

    Snakemake 9 starts a timer at every look at its queue, and each ends in another look. So every finished job adds one
    look per second, for good: after hundreds of jobs its own process takes a core.
    """
    queue = [one for one in threading.enumerate() if isinstance(one, threading.Timer) and _QUEUE in str(one.function)]
    for timer in queue[:-1]:
        timer.cancel()


class LogHandler(LogHandlerBase):
    """Snakemake's logger plugin `cortet`: it sees every event, and has its own words unless all is to be shown."""

    writes_to_stream = has_filter = has_formatter = True
    writes_to_file = needs_rulegraph = False

    def __post_init__(self) -> None:
        Handler.__init__(self)  # the base class of Snakemake 9.0 leaves it out
        self.has_filter = self.has_formatter = not self.common_settings.verbose
        self.stream, self.progress = sys.stdout, Progress()
        self._live, self._last, self._said_at = self.stream.isatty(), "", self.progress.clock()
        # what is said at the end; until a run starts, it may be the answer to an option of Snakemake
        self._at_end: list[str] = []
        self._runs = self._is_over = False

    def emit(self, record: LogRecord) -> None:
        """Say what an event means, if it means anything to a user."""
        try:
            for line in self._lines(record) if self.has_formatter else [self.format(record)]:
                self._say(line)
            if self._live and self.progress.running:
                self._show(self.progress.live())
        except Exception:  # a message must not end a run
            self.handleError(record)

    def close(self) -> None:
        """Say how it ended."""
        if self.progress.stopped:
            done, total = self.progress.jobs
            self._at_end = [f"{_STOPPED} after {done} of {total} jobs; the same command goes on from there"]
        self._show("")
        for line in self._at_end:
            self._say(line)
        self.progress.stopped, self._at_end = False, []  # it is closed again
        super().close()

    def _lines(self, record: LogRecord) -> Iterator[str]:
        """What to say of a record, line by line; an empty line is not said."""
        progress, known = self.progress, record.__dict__
        match known.get("event"):
            case LogEvent.WORKFLOW_STARTED:
                self._runs, self._at_end = True, ["nothing to do: everything is up to date"]
            case LogEvent.RUN_INFO:  # of a dry run before and after its jobs
                self._at_end = []
                yield from progress.would_do() if progress.plan else [progress.planned(known["stats"])]
            case LogEvent.JOB_INFO if self.common_settings.dryrun:
                progress.plan[(known["wildcards"] or {}).get("case", "")][known["rule_name"]] += 1
            case LogEvent.JOB_INFO:
                wildcards = dict(known["wildcards"] or {})
                progress.started(known["jobid"], known["rule_name"], wildcards, list(known["output"]))
            case LogEvent.JOB_FINISHED:
                end_older_timers()
                yield progress.ended(known["job_id"])
            case LogEvent.JOB_ERROR:
                yield progress.failed(known["jobid"], next(iter(known["log"] or []), ""))
            case LogEvent.PROGRESS:
                progress.jobs = (known["done"], known["total"])
                if not self._live and progress.clock() - self._said_at > _SILENCE:
                    yield progress.live()
            case LogEvent.ERROR | None if record.levelno >= ERROR:
                if not self._repeats(known.get("exception")):
                    self._at_end = []
                    yield record.getMessage()
            case None if record.levelno == WARNING:
                yield record.getMessage()
            case None if not self._runs and record.levelno == INFO:
                self._at_end.append(record.getMessage())
            case None:
                progress.stopped = progress.stopped or record.getMessage().startswith(_TERMINATING)

    def _repeats(self, exception: str | None) -> bool:
        """Whether an error says again what the lines on failed jobs have said, or that the run was stopped.

        When all jobs are over and some have failed, errors of no exception count them, of Snakemake and then of the
        workflow; after them comes a `WorkflowError`.
        """
        if self.progress.stopped or (self.progress.failures and exception is None):
            self._is_over = True
        return exception in _OF_JOBS or (self._is_over and exception in (None, "WorkflowError"))

    def _say(self, line: str) -> None:
        if line:
            self._show("")
            self.stream.write(f"{line}\n")
            self.stream.flush()
            self._said_at = self.progress.clock()

    def _show(self, line: str) -> None:
        """Replace the last line of a terminal."""
        if line or self._last:
            self.stream.write(f"\r{line:<{len(self._last)}}" + ("\r" if not line else ""))
            self.stream.flush()
            self._last = line

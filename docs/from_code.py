"""What the pages say about parameters, commands, checks and messages, taken from the code at the moment they are built.

Directives: `parameters SECTION` of the configuration, `commands` of the command line, `limits` of
the certificate, `messages MODULE...` with their remedies. What a directive contains in a page says where to look
without a build, as on a code host. A page explains one message under `message TEXT` and one
check under `check NAME`: a text or name that the code does not have, or a check that no page explains, is a warning of
the build.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import product
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import numpy as np
from cyclopts import App, Argument
from docutils import nodes
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from cortet.cli import commands
from cortet.config import SETTINGS, Config
from cortet.config.section import Section
from cortet.stages import STAGES
from cortet.stages.stage import Stage

PACKAGE = Path(__file__).resolve().parents[1] / "cortet"
ERRORS = ("InputError", "DamagedFileError", "StageError", "WorkflowError")
#: functions whose strings are messages though they raise none
SPEAKERS = {
    "cohort.ages": ("age_of", "_from_birth"),
    "cohort.scan": ("scan",),
    "cohort.sheet": ("_row_problems", "_name_problems", "_value_problems", "_phantom_problems", "read_sheet"),
    "cohort.selection": ("ageless_notice",),
    "config.files": ("_complaint",),
    "config.section": ("_whole_micrometres",),
    "formats.tsv": ("read_uneven_tsv",),
    "geometry.topology": ("problems",),
    "meshers.lattice": ("_fault",),
    "stages.smooth_surface": ("_candidate",),
    "measure.worst": ("_reason",),
    "solver_files.conventions": None,
    "folding.fold": ("_verdict",),
    "folding.plausible": ("_side",),
}
#: what a message says at this place depends on the case
GAP = "…"

logger = logging.getLogger(__name__)


class Message(NamedTuple):
    """A text that users may meet, and what it tells them to do."""

    #: module below `cortet`
    module: str
    text: str
    remedies: tuple[str, ...] = ()


# --- stages ----------------------------------------------------------------------------------------------------------


def stages_table() -> str:
    """The line of stages as a table, each with a link to its page; the page holds it, and a test compares."""
    rows = [
        f"| [{f'{stage.number} {stage.name}'.strip()}]({stage.name}.md) | {stage.does} | {_when(stage)} |"
        for stage in STAGES.values()
    ]
    return "\n".join(["| stage | what it does | when |", "|---|---|---|", *rows])


def _when(stage: Stage) -> str:
    if stage.nested:
        return "there are inner surfaces"
    if stage.registered:
        return "the surface has a sphere"
    return "always" if stage.is_on(Config()) else f"`{stage.name}.enabled`"


# --- parameters ------------------------------------------------------------------------------------------------------


class Parameters(SphinxDirective):
    """Every key of a section of the configuration: type, default, value in other settings, meaning."""

    has_content = True
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Nodes of the keys."""
        model: type[Section] = Config
        settings: dict[str, Any] = SETTINGS
        name = self.arguments[0]
        for part in () if name == "." else name.split("."):
            model = model.model_fields[part].annotation  # type: ignore[assignment]
            settings = {setting: values.get(part, {}) for setting, values in settings.items()}
        text = "\n".join(_described(model, "" if name == "." else f"{name}.", settings, deep=name != "."))
        return self.parse_text_to_nodes(text)


def _described(model: type[Section], prefix: str, settings: dict[str, Any], *, deep: bool) -> Iterator[str]:
    for key, info in model.model_fields.items():
        if isinstance(info.annotation, type) and issubclass(info.annotation, Section):
            below = {setting: values.get(key, {}) for setting, values in settings.items()}
            if deep:
                yield f"{info.annotation.__doc__}\n"
                yield from _described(info.annotation, f"{prefix}{key}.", below, deep=deep)
            continue
        default = info.get_default(call_default_factory=True)
        default = default.as_posix() if isinstance(default, Path) else default
        others = [f"`{setting}`: `{_plain(values[key])}`" for setting, values in settings.items() if key in values]
        yield f"````{{confval}} {prefix}{key}\n:type: {type_in_words(info)}\n:default: `{_plain(default)}`\n"
        yield " ".join((info.description or "").split()) + "\n"
        yield f"In the setting {', '.join(others)}.\n" if others else ""
        yield "````\n"


def _leaves(model: type[Section], prefix: str = "") -> Iterator[str]:
    """Dotted names of all keys that are not sections."""
    for key, info in model.model_fields.items():
        if isinstance(info.annotation, type) and issubclass(info.annotation, Section):
            yield from _leaves(info.annotation, f"{prefix}{key}.")
        else:
            yield prefix + key


def type_in_words(info: FieldInfo) -> str:
    """Type of a key with its limits, e.g. "number above 0"."""
    return _words(Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation)


def _words(kind: Any, many: bool = False) -> str:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        fields = [item for item in inner[1:] if isinstance(item, FieldInfo)]
        limits = map(_limit, [*inner[1:], *(item for field in fields for item in field.metadata)])
        return " ".join([_words(inner[0], many), " and ".join(filter(None, limits))]).strip()
    if origin in (Union, UnionType, Literal):
        *words, last = _alternatives(kind)
        return f"{', '.join(words)} or {last}" if words else last
    if origin is list:
        return f"list of {_words(inner[0], many=True)}"
    if origin is dict:
        return f"mapping of {_words(inner[0], many=True)} to {_words(inner[1], many=True)}"
    names = {int: "whole number", float: "number", str: "text", Path: "file name", Any: "value"}
    return f"{names[kind]}{'s' * many}" if kind in names else {bool: "`true` or `false`", NoneType: "`null`"}[kind]


def _alternatives(kind: Any) -> list[str]:
    if get_origin(kind) is Literal:
        return [f"`{value}`" for value in get_args(kind)]
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else ()
    return [word for part in parts for word in _alternatives(part)] or [_words(kind)]


def _limit(item: Any) -> str:
    words = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
    return " and ".join(f"{word} {getattr(item, sign):g}" for sign, word in words.items() if hasattr(item, sign))


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


# --- commands --------------------------------------------------------------------------------------------------------


class Commands(SphinxDirective):
    """Every command of the command line: arguments and options, as its function has them."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """A section for each command."""
        text = "\n".join(line for name, command in commands() for line in _usage(name, command))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def _usage(name: str, command: App) -> Iterator[str]:
    does, _, rest = command.help.partition("\n")
    example = rest.partition("Examples")[2].strip(" -\n")
    yield f"## {name}\n\n{does}\n"
    yield f"```text\n{example}\n```\n"
    yield f"```{{program}} {name}\n```\n"
    for one in command.assemble_argument_collection(parse_docstring=True):
        if one.show:
            yield from _argument(one)


def _argument(one: Argument) -> Iterator[str]:
    choices = one.get_choices()
    value = "" if one.is_flag() else "{" + ",".join(choices) + "}" if choices else one.parameter.metavar or ""
    flags = [one.name] if one.field_info.is_positional else [f"{flag} {value}".strip() for flag in one.names]
    required = " Required." if one.required and not one.field_info.is_positional else ""
    text = re.sub(r"(--[a-z-]+)", r"`\1`", " ".join((one.parameter.help or "").split()))
    yield f"```{{option}} {', '.join(flags)}\n\n{text}{required}\n```\n"


# --- checks ----------------------------------------------------------------------------------------------------------


class Limits(SphinxDirective):
    """Table of the certificate's checks with their limits and remedies, as `certify` makes them."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """The table."""
        rows = ["| check | limit | what to change where it fails |", "|---|---|---|"]
        for check in checks():
            unit = "h" if check.id in _FRACTIONS else check.unit  # it was checked with h = 1 mm
            limit = f"{_SIGNS[check.comparison]} {check.limit:g} {unit}".strip()
            remedy = check.remedy or "nothing: it is a fault of a stage; report it"
            if check.id == "worst_q":
                remedy = "depends on the element: see below"
            rows.append(f"| {{check}}`{check.name}` | {limit} | {remedy} |")
        return self.parse_text_to_nodes("\n".join(rows))


#: checks whose limits are fractions of the cell size
_FRACTIONS = (
    *("surface_distance", "mean_surface_distance", "face_centre_distance"),
    *("native_distance", "mean_native_distance"),
)
_SIGNS = {"<": "below", "<=": "at most", "==": "exactly", ">=": "at least"}


@cache
def checks() -> tuple[Any, ...]:
    """The checks of a small mesh that has been through S1: a ball of tetrahedra that meet in its centre."""
    from cortet.geometry.icosphere import icosphere
    from cortet.measure.certify import certify
    from cortet.meshes import TetMesh

    surface = icosphere(2)
    centre = np.full((len(surface.faces), 1), len(surface.points))
    mesh = TetMesh(np.vstack([surface.points, np.zeros(3)]), np.hstack([surface.faces[:, ::-1], centre]))
    reports = {"generate": {"topology_ok": True}, "repair": {"repaired": False}}
    return certify(mesh, surface, cell_size=1.0, native=surface, reports=reports).checks


# --- messages --------------------------------------------------------------------------------------------------------


#: parts of cortet as users know them, and their modules; what is not named here is listed last
PARTS = {
    "Cohort sheet": ("cohort.sheet", "cohort.scan"),
    "Configuration": ("config",),
    "Surfaces and fields": ("formats.gifti", "solver_files.fields", "phantom"),
    "Resampling": ("stages.resample", "geometry.spheres", "report.cohort_maps"),
    "Repair": ("stages.repair", "geometry.holes", "geometry.handles", "geometry.uncrossing", "formats.placement"),
    "Gate": ("stages.gate", "geometry.topology"),
    "Stages": ("stages", "meshers"),
    "Certificate and export": ("measure", "solver_files.export", "solver_files.sets", "cohort.failures"),
    "Solver files": ("formats",),
    "Verification of solver files": ("solver_files",),
    "Folding": ("folding",),
    "Everything else": ("",),
}


class Messages(SphinxDirective):
    """Messages of modules with their remedies; without modules those of all parts, a section for each."""

    has_content = True
    optional_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Lists of messages."""
        if self.arguments:
            found = _of(tuple(self.arguments[0].split()), messages())
            if not found:
                logger.warning("no messages in %s", self.arguments[0], location=self.get_location())
            return self.parse_text_to_nodes(_listed(found))
        left, lines = list(messages()), []
        for part, modules in PARTS.items():
            found = _of(modules, left)
            left = [message for message in left if message not in found]
            lines += [f"### {part}", _listed(found)] if found else []
        return self.parse_text_to_nodes("\n\n".join(lines), allow_section_headings=True)


def _of(modules: tuple[str, ...], candidates: Iterable[Message]) -> list[Message]:
    """Those of some modules and of what is below them; `` stands for all."""
    return [
        message for message in candidates if any(f"{message.module}.".startswith(f"{m}." if m else "") for m in modules)
    ]


def _listed(found: Iterable[Message]) -> str:
    return "\n".join(f"- `` {message.text} ``{_sentences(message.remedies)}" for message in dict.fromkeys(found))


def _sentences(remedies: Iterable[str]) -> str:
    """Remedies below the message, as sentences."""
    ended = (remedy if remedy.endswith(GAP) else f"{remedy}." for remedy in remedies)
    return "".join(f"\\\n  {remedy[:1].upper()}{remedy[1:]}" for remedy in ended)


@cache
def messages() -> tuple[Message, ...]:
    """All messages of the package, in the order of modules and lines."""
    return tuple(message for path in sorted(PACKAGE.rglob("*.py")) for message in _messages_of(path))


def _messages_of(path: Path) -> list[Message]:
    module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    outer = _assigned(tree.body)
    found: dict[tuple[int, str], Message] = {}
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    if gone := {*(SPEAKERS.get(module) or ())} - {function.name for function in functions}:
        raise LookupError(f"SPEAKERS names functions that {module} does not have: {', '.join(gone)}")
    for function in functions:
        known = outer | _assigned(ast.walk(function))
        for node, block in _calls(function):
            if getattr(node.func, "id", "") in ERRORS and node.args:
                known = known | _assigned(inner for statement in block for inner in ast.walk(statement))
                remedies = [word.value for word in node.keywords if word.arg == "remedy"]
                hints = tuple(hint for value in remedies for hint in texts(value, known) if hint != GAP)
                for text in texts(node.args[0], known):
                    if len(re.findall(r"[A-Za-z]{2,}", text)) >= 2:
                        found[node.lineno, text] = Message(module, text, hints)
        if function.name in (SPEAKERS.get(module, ()) or (function.name,) * (module in SPEAKERS)):
            for line, text in _said(function, known):
                what, remedy = _split(text) if module in ("cohort.sheet", "formats.tsv") else (text, ())
                found.setdefault((line, what), Message(module, what, remedy))
    return [message for _, message in sorted(found.items(), key=lambda item: item[0])]


def _calls(function: ast.FunctionDef) -> Iterator[tuple[ast.Call, list[ast.stmt]]]:
    """Calls in a function, each with the innermost block of statements that it stands in."""
    blocks = [
        statements
        for node in ast.walk(function)
        for statements in (getattr(node, "body", None), getattr(node, "orelse", None))
        if isinstance(statements, list) and statements
    ]
    innermost = {id(node): block for block in blocks for statement in block for node in ast.walk(statement)}
    for node in ast.walk(function):
        if isinstance(node, ast.Call) and id(node) in innermost:
            yield node, innermost[id(node)]


def _assigned(body: Iterable[ast.AST]) -> dict[str, list[ast.expr]]:
    """Name -> what is assigned to it."""
    found: dict[str, list[ast.expr]] = {}
    for node in body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found.setdefault(node.targets[0].id, []).append(node.value)
    return found


def texts(node: ast.expr, known: dict[str, list[ast.expr]]) -> list[str]:
    """What an expression may say, with a gap for everything that depends on the case."""
    if isinstance(node, ast.Constant):
        return [str(node.value)]
    if isinstance(node, ast.IfExp):
        return texts(node.body, known) + texts(node.orelse, known)
    if isinstance(node, ast.Name) and node.id in known:
        return [text for value in known[node.id] for text in texts(value, {**known, node.id: []})] or [GAP]
    parts: list[list[str]] = [[GAP]]
    if isinstance(node, ast.FormattedValue) and isinstance(node.value, ast.Call):
        node = node.value
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "counted":
        plural = [text for argument in node.args[1:] for text in texts(argument, known)]
        parts = [[f"{GAP} {plural[1] if plural[1:] else plural[0] + 's'}"]]
    elif isinstance(node, ast.JoinedStr):
        parts = [texts(value, known) for value in node.values]
    elif isinstance(node, ast.FormattedValue) and getattr(node.value, "id", "") in known:
        parts = [[text if " " in text else GAP for text in texts(node.value, known)]]
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        parts = [texts(node.left, known), texts(node.right, known)]
    return [re.sub(rf"{GAP}([:;,\s]*{GAP})+", GAP, " ".join("".join(choice).split())) for choice in product(*parts)]


def _said(function: ast.FunctionDef, known: dict[str, list[ast.expr]]) -> Iterator[tuple[int, str]]:
    """Strings of several words in the body of a function, errors apart."""
    skipped = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ERRORS:
            skipped |= {id(inner) for inner in ast.walk(node)}
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(inner) for inner in node.values}
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
    for node in ast.walk(function):
        if isinstance(node, (ast.JoinedStr, ast.Constant)) and id(node) not in skipped:
            for text in texts(node, known) if not isinstance(getattr(node, "value", ""), (int, float)) else ():
                if len(re.findall(r"[A-Za-z]{2,}", text)) >= (4 if isinstance(node, ast.Constant) else 2):
                    yield node.lineno, text


def _split(text: str) -> tuple[str, tuple[str, ...]]:
    """A message that ends in a remedy in brackets, as the errors print it."""
    found = re.fullmatch(r"(.*\S) \(([^()]*)\)", text)
    return (found[1], (found[2],)) if found else (text, ())


# --- what pages explain ----------------------------------------------------------------------------------------------


def check_explanations(_: Sphinx, environment: BuildEnvironment) -> None:
    """Warn of explanations of what the code does not have, and of checks and keys that no page explains."""
    explained: dict[str, dict[str, str]] = {kind: {} for kind in ("message", "check", "confval")}
    for name, _, kind, page, *_ in environment.domains.standard_domain.get_objects():
        if kind in explained:
            explained[kind][" ".join(name.split())] = page
    known = {
        "message": {message.text for message in messages()},
        "check": {check.name for check in checks()},
        "confval": set(_leaves(Config)),
    }
    for kind, found in explained.items():
        for name in found.keys() - known[kind]:
            logger.warning("the code has no %s %r", kind, name, location=found[name])
    for kind in ("check", "confval"):
        for name in sorted(known[kind] - explained[kind].keys()):
            logger.warning("no page explains the %s %r", kind, name)


def describe_below(_app: Sphinx, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Put what follows `name : ` in a docstring below the name, since it is a description, not a type."""
    for number, line in reversed(list(enumerate(lines))):
        section = next((lines[i - 1] for i in range(number, 0, -1) if re.fullmatch("-{3,}", lines[i])), "")
        if section in ("Parameters", "Raises") and (found := re.fullmatch(r"(\S[\w, ]*) : (.+)", line)):
            lines[number : number + 1] = [found[1], f"    {found[2]}"]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("parameters", Parameters)
    app.add_directive("commands", Commands)
    app.add_directive("limits", Limits)
    app.add_directive("messages", Messages)
    app.add_object_type("message", "message", objname="message", ref_nodeclass=nodes.inline)
    app.add_object_type("check", "check", objname="check of the certificate", ref_nodeclass=nodes.inline)
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", describe_below, priority=400)  # before napoleon parses it
    app.connect("env-check-consistency", check_explanations)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Configuration files: reading, checking, and writing with every key explained."""

from __future__ import annotations

import difflib
import re
import reprlib
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from cortet.config.section import Section
from cortet.config.settings import SETTINGS
from cortet.config.stages import Config
from cortet.errors import InputError
from cortet.formats.untrusted import content


def load(source: Path | str | Mapping[str, Any]) -> Config:
    """The validated configuration of a YAML file or a plain dict.

    Raises `InputError` naming every offending key with its value and, for an unknown key, one with a similar name.
    """
    data = read(Path(source)) if isinstance(source, (str, Path)) else dict(source)
    place = source if isinstance(source, (str, Path)) else "configuration"
    data = _overlaid(SETTINGS.get(str(data.get("setting")), {}), data)
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        found = error.errors(include_url=False)
        what = "; ".join(_joined([_complaint(problem, data) for problem in found]))
        is_unknown = any(problem["type"] == "extra_forbidden" for problem in found)
        remedy = "CHANGELOG.md says what replaced a removed key" if is_unknown else None
        raise InputError(what, file=place, remedy=remedy) from None


def render(data: Mapping[str, Any]) -> str:
    """Documented YAML of a configuration: keys in `data` are set; the others are comments with their defaults."""
    head = (
        "# Configuration of cortet. Keys that are commented out show their value in the `default` setting.\n"
        "# Use another file with `snakemake --configfile FILE`, or change single keys with\n"
        "# `snakemake --config setting=published generate='{cell_size: 1.0}'`.\n"
    )
    return head + "".join(_rendered(Config, data, SETTINGS, indent=0, commented=False))


def read(path: Path) -> dict[str, Any]:
    """The content of a YAML file of the configuration, not validated."""
    remedy = "give a YAML file of keys and values"
    try:
        data = yaml.load(content(path).decode("utf-8"), Loader=_UniqueKeys)
    except _Twice as error:
        raise InputError(str(error), file=path, remedy="merge the two into one") from None
    except (ValueError, TypeError, AttributeError, RecursionError, yaml.YAMLError) as error:  # PyYAML also raises these
        raise InputError(f"cannot be read: {error}", file=path, remedy=remedy) from None
    if not isinstance(data, dict):
        raise InputError("holds no keys", file=path, remedy=remedy)
    return data


def keys_not_given(data: Mapping[str, Any], given: Mapping[str, Any]) -> list[str]:
    """Keys whose value is neither in `given` nor the default: for each `section.key: value (default: value)`."""
    defaults, own = dict(_leaves(Config().model_dump())), dict(_leaves(given))
    others = {key: value for key, value in _leaves(data) if key not in own and value != defaults.get(key)}
    return [f"{key}: {_yaml(value)} (default: {_yaml(defaults.get(key))})" for key, value in others.items()]


def _leaves(data: Mapping[str, Any], parents: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in data.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, f"{parents}{key}.")
        else:
            yield parents + str(key), value


class _Twice(Exception):  # noqa: N818, becomes an InputError
    """A key that a mapping of a YAML file holds twice."""


class _UniqueKeys(yaml.SafeLoader):  # type: ignore[misc]
    """A loader that refuses a repeated key, which YAML forbids; PyYAML would take the last value."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Raise _Twice for a key that occurs twice."""
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
                line = key.start_mark.line + 1
                if lines.setdefault(key.value, line) != line:
                    raise _Twice(f"key {key.value} appears twice, in line {lines[key.value]} and in line {line}")
        return super().construct_mapping(node, deep)


def _overlaid(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over` put on top, section by section."""
    result = dict(base)
    for key, value in over.items():
        if isinstance(result.get(key), Mapping) and isinstance(value, Mapping | None):
            result[key] = _overlaid(result[key], value or {})
        else:
            result[key] = value
    return result


#: names that pydantic gives to the types of a value; they are not part of a key's name
_OF_A_UNION = re.compile(r"float$|int$|str$|(dict|list|constrained|literal)\b.*|\[key\]$")

#: how pydantic begins most of its messages
_WANTED = "Input should be "


def _joined(problems: list[tuple[str, str]]) -> list[str]:
    """Complaints, with one for each key: a value that may be of several types has a problem with each of them."""
    messages: dict[str, list[str]] = {}
    for about, message in problems:
        messages.setdefault(about, []).append(message)
    lines = []
    for about, several in messages.items():
        first, *others = dict.fromkeys(several)
        lines.append(f"{about}{first}" + "".join(f", or {other.removeprefix(_WANTED)}" for other in others))
    return lines


def _complaint(problem: Any, data: Mapping[str, Any]) -> tuple[str, str]:
    """One finding of pydantic in the user's words: the key with its value, and what is wrong with it."""
    name = ".".join(_keys_on_the_way(problem["loc"], data))
    if problem["type"] != "extra_forbidden":
        return f"{name} = {reprlib.repr(problem['input'])}: ", problem["msg"].removeprefix("Value error, ")
    nearest = difflib.get_close_matches(name, _keys(Config), n=1)
    suggestion = f"did you mean {nearest[0]}?" if nearest else "`cortet config` prints every key"
    return f"unknown key {name}; {suggestion}", ""


def _keys_on_the_way(loc: tuple[str | int, ...], data: Any) -> Iterator[str]:
    """The keys on the path to a value, without list indices: the value itself shows which item is meant."""
    for part in loc:
        if _OF_A_UNION.match(str(part)):
            continue
        if isinstance(data, Mapping) or not isinstance(part, int):
            yield str(part)
        data = data.get(part) if isinstance(data, Mapping) else None


def _keys(model: type[BaseModel], parents: str = "") -> Iterator[str]:
    """Dotted names of all keys, sections included."""
    for name, info in model.model_fields.items():
        yield parents + name
        if _is_section(info):
            yield from _keys(cast(type[BaseModel], info.annotation), f"{parents}{name}.")


def _is_section(info: FieldInfo) -> bool:
    return isinstance(info.annotation, type) and issubclass(info.annotation, Section)


def _rendered(
    model: type[Section],
    data: Mapping[str, Any],
    settings: Mapping[str, Mapping[str, Any]],
    *,
    indent: int,
    commented: bool,
) -> Iterator[str]:
    pad = " " * indent
    for name, info in model.model_fields.items():
        given = data.get(name)
        hidden = "# " if commented or name not in data else ""
        if _is_section(info):
            section: Any = info.annotation
            yield f"\n{pad}# {section.__doc__}\n{pad}{hidden}{name}:\n"
            below = {setting: values.get(name, {}) for setting, values in settings.items()}
            yield from _rendered(section, given or {}, below, indent=indent + 2, commented=bool(hidden))
            continue
        text = " ".join((info.description or "").split())
        text += "".join(f" {setting}: {_yaml(values[name])}" for setting, values in settings.items() if name in values)
        yield "\n" if indent == 0 else ""
        yield textwrap.indent(textwrap.fill(text, 118 - indent, break_long_words=False), f"{pad}# ") + "\n"
        yield f"{pad}{hidden}{name}: {_yaml(given if name in data else info.default)}\n"


def _yaml(value: Any) -> str:
    """One line of YAML for one value."""
    plain = value.as_posix() if isinstance(value, Path) else value
    text: str = yaml.safe_dump(plain, default_flow_style=True, width=10_000)
    return text.removesuffix("\n").removesuffix("\n...")

"""YAML nodes become plain data whose every key and value remembers its place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import yaml

from pipeline.configtext.compose import MAX_DEPTH
from pipeline.configtext.report import Path, Place, Problem, Source, report, show
from pipeline.configtext.variables import substitute

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

MAX_VALUES = 100_000

_TAG = "tag:yaml.org,2002:"
_TEXT_TAGS = {f"{_TAG}str", f"{_TAG}value", f"{_TAG}merge"}  # a lone '=' or '<<' as a value is just text
_MERGE = f"{_TAG}merge"
_KINDS = {"bool": "true or false", "null": "nothing", "int": "a number", "float": "a number", "timestamp": "a date"}
_CONSTRUCTOR = yaml.constructor.SafeConstructor()
_CONSTRUCT: dict[str, Callable[[yaml.ScalarNode], Any]] = {
    f"{_TAG}null": _CONSTRUCTOR.construct_yaml_null,
    f"{_TAG}bool": _CONSTRUCTOR.construct_yaml_bool,
    f"{_TAG}int": _CONSTRUCTOR.construct_yaml_int,
    f"{_TAG}float": _CONSTRUCTOR.construct_yaml_float,
    f"{_TAG}timestamp": _CONSTRUCTOR.construct_yaml_timestamp,
    f"{_TAG}binary": _CONSTRUCTOR.construct_yaml_binary,
}
_RESOLVER: Any = yaml.resolver.Resolver()

Pair = tuple[yaml.Node, yaml.Node]
Places = dict[Path, tuple[Place, Place]]


class Builder:
    """Builds the data of one text and gathers places and problems; `environ` None leaves ``${`` alone."""

    def __init__(self, source: Source, tagged: set[int], environ: Mapping[str, str] | None) -> None:
        self.places: Places = {}
        self.problems: list[tuple[Place, Problem]] = []
        self._source = source
        self._tagged = tagged
        self._environ = environ
        self._open: set[int] = set()
        self._left = MAX_VALUES

    def build(self, node: yaml.Node, path: Path, key: Place | None = None) -> Any:
        """The data of the node, which stands at the path; a part with a problem becomes None."""
        value = self._place(node)
        self.places[path] = (key or value, value)
        self._spend(node, path, len(path))
        if id(node) in self._open:
            return self._refuse(node, path, "an alias inside its own anchor would never end")
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, path)
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.SequenceNode) and node.tag == f"{_TAG}seq":
                return [self.build(item, (*path, index)) for index, item in enumerate(node.value)]
            if isinstance(node, yaml.MappingNode) and node.tag == f"{_TAG}map":
                return self._mapping(node, path)
        finally:
            self._open.discard(id(node))
        return self._refuse(node, path, *_about_tag(node.tag))

    def _mapping(self, node: yaml.MappingNode, path: Path) -> dict[str, Any]:
        own, merged = self._pairs(node, path, len(path))
        data: dict[str, Any] = {}
        for pairs, is_merge in ((own, False), (merged, True)):
            seen: dict[str, yaml.Node] = {}
            for key_node, value_node in pairs:
                key = self._key(key_node, path)
                if key is None or (is_merge and key in data):
                    continue
                if key in seen:
                    line = seen[key].start_mark.line + 1
                    self._refuse(key_node, (*path, key), f"given twice, first in line {line}", at="key")
                    continue
                seen[key] = key_node
                data[key] = self.build(value_node, (*path, key), self._place(key_node))
        return data

    def _pairs(self, node: yaml.MappingNode, path: Path, depth: int) -> tuple[list[Pair], list[Pair]]:
        """The pairs of the mapping itself, and those that its ``<<`` brings, the strongest first."""
        own: list[Pair] = []
        merged: dict[object, Pair] = {}
        for key, value in node.value:
            if key.tag != _MERGE:
                own.append((key, value))
                continue
            parts = value.value if isinstance(value, yaml.SequenceNode) else [value]
            for part in parts:
                self._spend(part, path, depth + 1)
                if not isinstance(part, yaml.MappingNode):
                    self._refuse(part, (*path, "<<"), "merges mappings only, e.g. '<<: *defaults'")
                elif part is node or id(part) in self._open:
                    self._refuse(part, (*path, "<<"), "a mapping cannot be merged into itself")
                else:
                    for pairs in self._pairs(part, path, depth + 1):
                        for pair in pairs:
                            self._spend(pair[0], path, depth)
                            merged.setdefault((pair[0].tag, str(pair[0].value)), pair)
        return own, list(merged.values())

    def _key(self, node: yaml.Node, path: Path) -> str | None:
        if not isinstance(node, yaml.ScalarNode):
            self._refuse(node, path, "a key must be a text, not a list or a mapping", at="key")
            return None
        if node.tag in _TEXT_TAGS:
            return str(node.value)
        name = str(node.value)
        if node.tag in _CONSTRUCT:
            message = f"YAML reads this key as {_kind(node.tag)}, not as a text"
            self._refuse(node, (*path, name), message, f"write {show(name)}", at="key")
        else:
            self._refuse(node, (*path, name), *_about_tag(node.tag), at="key")
        return None

    def _scalar(self, node: yaml.ScalarNode, path: Path) -> Any:
        text, tag = str(node.value), node.tag
        if self._environ is not None and "${" in text:
            text, complaints = substitute(text, self._environ)
            for complaint in complaints:
                self._refuse(node, path, complaint)
            if complaints:
                return None
            if not node.style and id(node) not in self._tagged:
                tag = _RESOLVER.resolve(yaml.ScalarNode, text, (True, False))
        if tag in _TEXT_TAGS:
            return text
        if tag not in _CONSTRUCT:
            return self._refuse(node, path, *_about_tag(tag))
        try:
            return _CONSTRUCT[tag](yaml.ScalarNode(tag, text, node.start_mark, node.end_mark))
        except (ValueError, LookupError, AttributeError, OverflowError, yaml.YAMLError):
            return self._refuse(
                node, path, f"{show(text)} cannot be read as {_kind(tag)}", "put it in quotes if it is a text"
            )

    def _spend(self, node: yaml.Node, path: Path, depth: int) -> None:
        self._left -= 1
        if self._left < 0:
            message = f"more than {MAX_VALUES} values, counting every use of an alias"
        elif depth > MAX_DEPTH:
            message = f"nested more than {MAX_DEPTH} levels deep"
        else:
            return
        raise report([(self._place(node), Problem(path[:3], message))], [self._source])

    def _refuse(
        self,
        node: yaml.Node,
        path: Path,
        message: str,
        hint: str | None = None,
        *,
        at: Literal["key", "value"] = "value",
    ) -> None:
        self.problems.append((self._place(node), Problem(path, message, hint, at)))

    def _place(self, node: yaml.Node) -> Place:
        return Place(self._source.label, node.start_mark.line + 1, node.start_mark.column + 1)


def _kind(tag: str) -> str:
    kind = tag.removeprefix(_TAG)
    return _KINDS.get(kind, kind)


def _about_tag(tag: str) -> tuple[str, str]:
    name = f"!!{tag.removeprefix(_TAG)}" if tag.startswith(_TAG) else tag
    return f"the tag {name if name.isprintable() else show(name)} is not supported here", "remove it"

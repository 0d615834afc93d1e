"""Where in the data a pydantic error belongs: its `loc` also names members of unions, which no data holds."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import AliasChoices, BaseModel

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pipeline.configtext.report import Path


@dataclass(frozen=True, slots=True)
class Spot:
    """A path in the data, which parts of the `loc` were labels of a union, and the model that holds the last key."""

    path: Path
    labels: tuple[int, ...] = ()
    owner: type[BaseModel] | None = None


def locate(model: type[BaseModel], loc: tuple[int | str, ...]) -> Spot:
    """The spot of an error in data that was validated by the model."""
    found = next(_walk(model, loc, 0, Spot(())), None)
    if found is not None:
        return found
    # A type this walk does not know: names of types hold brackets, keys of a configuration hardly ever do.
    return Spot(tuple(part for part in loc if isinstance(part, int) or not part.endswith(("]", ")"))))


def allowed_keys(model: type[BaseModel]) -> list[str]:
    """The keys a user may write in a mapping of the model."""
    names: list[str] = []
    for name, info in model.model_fields.items():
        alias = info.validation_alias
        names.append(alias if isinstance(alias, str) else name)
    return names


def _walk(annotation: Any, loc: tuple[int | str, ...], at: int, spot: Spot) -> Iterator[Spot]:
    """All readings of the rest of the `loc`, the likeliest first."""
    annotation = _peel(annotation)
    rest = loc[at:]
    if not rest or rest == ("[key]",):
        yield spot
        return
    part = rest[0]
    members = _members(annotation)
    if len(members) == 1:
        yield from _walk(members[0], loc, at, spot)
    elif members:
        labelled = Spot(spot.path, (*spot.labels, at), spot.owner)
        for member in sorted(members, key=lambda member: -_fit(member, part)):
            yield from _walk(member, loc, at + 1, labelled)
    elif _is_model(annotation):
        deeper = Spot((*spot.path, part), spot.labels, annotation)
        field = _field(annotation, part)
        if field is not None:
            yield from _walk(field, loc, at + 1, deeper)
        elif len(rest) == 1:
            yield deeper
    else:
        deeper = Spot((*spot.path, part), spot.labels)
        for inner in _inner(annotation, part):
            yield from _walk(inner, loc, at + 1, deeper)


def _peel(annotation: Any) -> Any:
    """The type inside Annotated and named aliases."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif hasattr(annotation, "__value__"):
            annotation = annotation.__value__
        else:
            return annotation


def _members(annotation: Any) -> list[Any]:
    if get_origin(annotation) not in (Union, types.UnionType):
        return []
    return [member for member in get_args(annotation) if member is not type(None)]


def _is_model(annotation: Any) -> bool:
    # Python 3.10 takes list[int] for a type that issubclass then refuses.
    return isinstance(annotation, type) and get_origin(annotation) is None and issubclass(annotation, BaseModel)


def _field(model: type[BaseModel], key: int | str) -> Any:
    """The annotation of the field that is written with this key, None if there is none."""
    for name, info in model.model_fields.items():
        alias = info.validation_alias
        names = (
            [choice for choice in alias.choices if isinstance(choice, str)] if isinstance(alias, AliasChoices) else []
        )
        if key in (name, alias, *names):
            return info.annotation
    return None


def _inner(annotation: Any, part: int | str) -> list[Any]:
    """What a container of this type holds at the index or key."""
    origin, arguments = get_origin(annotation) or annotation, get_args(annotation)
    if not isinstance(origin, type):
        return []
    if issubclass(origin, Mapping):
        return [arguments[1] if len(arguments) == 2 else Any]
    if not isinstance(part, int):
        return []
    if origin is tuple and arguments and arguments[-1] is not Ellipsis:
        return [arguments[min(part, len(arguments) - 1)]]
    return [arguments[0] if arguments else Any]


def _fit(member: Any, label: int | str) -> int:
    """How well a label names a member of a union."""
    member = _peel(member)
    if _is_model(member):
        tags = {tag for info in member.model_fields.values() for tag in _literals(info.annotation)}
        return 2 if label == member.__name__ or label in tags else 0
    if _members(member):
        return 1 if str(label).startswith("tagged-union") else 0
    name = getattr(get_origin(member) or member, "__name__", "")
    return 1 if name and str(label).startswith(name) else 0


def _literals(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) is Literal else ()

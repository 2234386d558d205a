"""What a schema has at a place: which keys a map may hold there, and what lies below them."""

from collections.abc import Iterable
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel


@dataclass(frozen=True)
class SchemaPlace:
    """A place in a document, as its schema has it.

    Attributes:
        kinds: What it may hold: models, maps, lists and scalars.
    """

    kinds: tuple[Any, ...]

    @classmethod
    def of(cls, *annotations: Any) -> "SchemaPlace":
        """Return the place of what is annotated in one of these ways."""
        return cls(tuple(_kinds(annotations)))

    @property
    def keys(self) -> list[str]:
        """The names of the fields that a map may have here; empty if it may have any, or none."""
        models = [kind for kind in self.kinds if _is_model(kind)]
        return [
            field.alias or name for model in models for name, field in model.model_fields.items()
        ]

    @property
    def may_be_map(self) -> bool:
        """Whether a map may stand here."""
        return any(_is_model(kind) or get_origin(kind) is dict for kind in self.kinds)

    def below(self, key: str) -> "SchemaPlace | None":
        """Return the place under a key of a map; None: there is no such key."""
        found = [get_args(kind)[1] for kind in self.kinds if get_origin(kind) is dict]
        for model in self.kinds:
            if _is_model(model):
                fields = {field.alias or name: field for name, field in model.model_fields.items()}
                found += [fields[key].annotation] if key in fields else []
        return SchemaPlace.of(*found) if found else None

    @property
    def item(self) -> "SchemaPlace":
        """The place of an item of a list."""
        lists = [kind for kind in self.kinds if get_origin(kind) in (list, tuple)]
        return SchemaPlace.of(*(each for kind in lists for each in get_args(kind)))


def _kinds(annotations: Iterable[Any]) -> Iterable[Any]:
    """Yield the alternatives that annotations stand for."""
    for annotation in annotations:
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin in (Union, UnionType):
            yield from _kinds(arguments)
        elif origin is Annotated:
            yield from _kinds(arguments[:1])
        else:
            yield annotation


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)

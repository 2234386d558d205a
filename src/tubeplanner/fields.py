"""Fields of files: their types, sections, and faults in terms of the file.

A field is declared once, in a dataclass of Python: its type, its default, its description, and its
kind in files where that is narrower. `section_of` makes the section of a file from the dataclass.
"""

import dataclasses
import inspect
from collections.abc import Callable, Iterable, Sequence
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeAlias,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
)

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model
from pydantic.fields import FieldInfo

from tubeplanner.errors import MAX_SHOWN, ProblemError, TubePlannerError, shown, unknown_name

# ---- Types of fields: strict, so that text is no number.


class Section(BaseModel):
    """A map with known keys."""

    what: ClassVar[str] = "the document is a map"

    # Built once, as part of the file's model, rather than for each section at import.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class DeclaredSection(Section):
    """A section with the declared fields of a dataclass, which `section_of` adds."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


_Section = TypeVar("_Section", bound=Section)
_Kind = TypeVar("_Kind")


def one_of(is_accepted: Callable[[Any], bool], kinds: str) -> BeforeValidator:
    """Return a validator with one message, naming the accepted kinds, for all alternatives."""

    def validated(value: Any) -> Any:
        if not is_accepted(value):
            raise ValueError(f"it must be {kinds}")
        return value

    return BeforeValidator(validated)


FORMAT_VERSION = 1  # of problem, cycle, study and preset files


def no_flag(value: object) -> object:
    """Raise if a number is true or false: in Python these are 1 and 0."""
    if isinstance(value, bool):
        raise ValueError("true and false are no numbers")
    return value


def known_version(value: object) -> object:
    """Raise if a value is no version of a format that this package reads."""
    if isinstance(value, bool) or value != FORMAT_VERSION:
        raise ValueError(f"{FORMAT_VERSION} can be read; a newer tubeplanner may read it")
    return value


def is_plain_number(value: object) -> bool:
    """Return True if a value of a file is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_pair(value: object) -> bool:
    """Return True if a value of a file is a list of two numbers."""
    return isinstance(value, list | tuple) and len(value) == 2 and all(map(is_plain_number, value))


Finite: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Number: TypeAlias = Annotated[float, Field(strict=True)]
Vector: TypeAlias = tuple[Finite, Finite, Finite]
Quaternion: TypeAlias = tuple[Finite, Finite, Finite, Finite]
Range: TypeAlias = tuple[Number, Number]
Flag: TypeAlias = Annotated[bool, Field(strict=True)]
Version: TypeAlias = Annotated[Literal[1], BeforeValidator(known_version)]


# ---- Fields of dataclasses that files have too.


def declaration(description: str, kind: Any = None, default: Any = ..., **more: Any) -> Any:
    """Return the metadata of a field of a dataclass that a section of a file has too.

    Args:
        description: In the JSON schema, with the unit in brackets.
        kind: Type in files; None: that of the dataclass.
        default: In files; ...: required.
        **more: Further properties of the field.
    """
    return {"description": description, "kind": kind, "default": default, **more}


def declared(default: Any, description: str, kind: Any = None, **more: Any) -> Any:
    """Return a field of a dataclass with a default, a tuple for the list of a file.

    Other arguments as of `declaration`.
    """
    metadata = declaration(description, kind, default, **more)
    if isinstance(default, dict):
        return dataclasses.field(default_factory=dict, metadata=metadata)
    of_python = tuple(default) if isinstance(default, list) else default
    return dataclasses.field(default=of_python, metadata=metadata)


def documented(kind: type[_Kind]) -> type[_Kind]:
    """Decorate a dataclass: its docstring has the descriptions of its fields."""
    fields: Any = dataclasses.fields(cast(Any, kind))
    rows = [f"\n    {field.name}: {field.metadata['description']}." for field in fields]
    kind.__doc__ = f"{inspect.cleandoc(kind.__doc__ or '')}\n\nAttributes:{''.join(rows)}"
    return kind


def section_of(kind: Any, *order: str) -> Callable[[type[_Section]], type[_Section]]:
    """Return a decorator that adds the declared fields of a dataclass to a section.

    Args:
        kind: The dataclass.
        *order: Names of the fields in the section's order; none: the dataclass' order.
    """
    fields: dict[str, Any] = {}
    for name in order or [field.name for field in dataclasses.fields(kind)]:
        own = kind.__dataclass_fields__[name]
        values = own.metadata
        field = Field(values["default"], description=values["description"])
        fields[name] = (values["kind"] or own.type, field)

    def decorated(section: type[_Section]) -> type[_Section]:
        return create_model(
            section.__name__,
            __base__=section,
            __doc__=section.__doc__,
            __module__=section.__module__,
            **fields,
        )

    return decorated


# ---- Locations in the schema of a document.


@dataclasses.dataclass(frozen=True)
class SchemaLocation:
    """Location in the schema of a document."""

    kinds: tuple[Any, ...]  # types that are valid here: models, maps, lists and scalars

    @classmethod
    def of(cls, *annotations: Any) -> "SchemaLocation":
        """Return the location of a value with alternative annotations."""
        return cls(tuple(_kinds(annotations)))

    @property
    def models(self) -> list[type[BaseModel]]:
        """Models of the maps that are valid here."""
        types = [kind for kind in self.kinds if isinstance(kind, type)]
        return [kind for kind in types if issubclass(kind, BaseModel)]

    @property
    def keys(self) -> list[str]:
        """Names of the fields of a map here; empty if any key is valid, or no map is."""
        return [key for model in self.models for key in _fields_by_key(model)]

    @property
    def may_be_map(self) -> bool:
        """True if a map is valid here."""
        return bool(self.models) or any(get_origin(kind) is dict for kind in self.kinds)

    def below(self, key: object) -> "SchemaLocation | None":
        """Return the location under a key of a map; None: the key is unknown."""
        annotations = [get_args(kind)[1] for kind in self.kinds if get_origin(kind) is dict]
        own = [_fields_by_key(model) for model in self.models]
        annotations += [fields[key].annotation for fields in own if key in fields]
        return SchemaLocation.of(*annotations) if annotations else None

    @property
    def item(self) -> "SchemaLocation":
        """Location of the items of a list."""
        lists = [kind for kind in self.kinds if get_origin(kind) in (list, tuple)]
        return SchemaLocation.of(*(each for kind in lists for each in get_args(kind)))


def _kinds(annotations: Iterable[Any]) -> Iterable[Any]:
    """Yield the types of annotations, unions taken apart."""
    for annotation in annotations:
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin in (Union, UnionType):
            yield from _kinds(arguments)
        elif origin is Annotated:
            yield from _kinds(arguments[:1])
        else:
            yield annotation


def _fields_by_key(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


# ---- Pydantic's faults in terms of the file.

_Path = tuple[int | str, ...]

# The required value for each of pydantic's fault types.
_REQUIREMENTS = {
    "bool_type": "true or false",
    "dict_type": "a map",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "list_type": "a list",
    "model_type": "a map",
    "string_type": "text",
    "tuple_type": "a list",
}


def _first_fault(data: dict[str, Any], error: ValidationError, root: type[BaseModel]) -> str:
    """Return the message of a document's first fault: field, value and required value."""
    faults = error.errors()
    # In a file of another version, any other fault may be due to that.
    fault = next((f for f in faults if f["loc"] == ("version",)), None) or _deepest(data, error)
    steps, kind = _steps(data, fault["loc"]), fault["type"]
    if kind == "extra_forbidden":
        keys = _fields_by_key(_model_at(root, fault["loc"][:-1]))
        section = _join(steps[:-1]) or "top level"
        return f"{section}: {unknown_name('key', str(fault['loc'][-1]), keys)}"
    if kind == "missing" and isinstance(fault["loc"][-1], int):
        count = 1 + max(step for f in faults if isinstance(step := f["loc"][-1], int))
        return f"{_join(steps)} has {fault['loc'][-1]} values; {count} are needed"
    if kind == "missing":
        name = fault["loc"][-1]
        return f"{_join(steps if steps[-1:] == [name] else [*steps, name])} is required"
    if kind == "too_long":
        sizes = fault["ctx"]
        return f"{_join(steps)} has more than {sizes['max_length']} values"
    if kind == "invalid_key" or fault["loc"][-1:] == ("[key]",):
        above = fault["loc"][: -1 if kind == "invalid_key" else -2]
        section = _join(_steps(data, above)) or "top level"
        return f"{section}: the key {shown(fault['input'])} is no text; quote it"
    value = "empty" if fault["input"] is None else shown(fault["input"])
    return f"{_join(steps) or 'the problem'} is {value}; {_requirement(fault, root)}"


def _deepest(data: dict[str, Any], error: ValidationError) -> Any:
    """Return the fault with the longest path: a union reports a fault for each of its members."""
    return max(error.errors(), key=lambda fault: len(_steps(data, fault["loc"])))


def _requirement(fault: Any, root: type[BaseModel]) -> str:
    if fault["type"] in ("model_type", "dict_type"):
        model = _model_at(root, fault["loc"])
        is_model = fault["type"] == "model_type" and (model is not root or not fault["loc"])
        keys = _fields_by_key(model) if is_model else {}
        return f"it must be a map with {', '.join(keys)}" if keys else "it must be a map"
    if fault["type"] in _REQUIREMENTS:
        return f"it must be {_REQUIREMENTS[fault['type']]}"
    message = str(fault["msg"]).removeprefix("Value error, ").lower()
    return message.replace("input should be", "it must be")


def _steps(data: object, path: _Path) -> list[int | str]:
    """Return the steps of a fault's path that exist in the data; others name union members."""
    steps: list[int | str] = []
    for step in path:
        try:
            data = data[step]  # type: ignore[index]
        except (KeyError, IndexError, TypeError):
            continue
        steps.append(step)
    return steps


def _join(steps: list[int | str]) -> str:
    """Return a path as text; keys that cannot be shown or are long, in quotes and cut."""
    text = ""
    for step in steps:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            is_plain = step.isprintable() and len(step) <= MAX_SHOWN
            text += f".{step if is_plain else shown(step)}"
    return text.lstrip(".")


def _model_at(root: type[BaseModel], path: _Path) -> type[BaseModel]:
    """Return the innermost model on a path; of alternatives, the model that the path names."""
    model, location = root, SchemaLocation((root,))
    for step in path:
        if named := [each for each in location.models if each.__name__ == step]:
            location = SchemaLocation(tuple(named))
        else:
            below = location.item if isinstance(step, int) else location.below(step)
            location = below or location
        model = location.models[0] if location.models else model
    return model


def check_fields(
    model: type[_Section],
    data: object,
    source: str,
    source_of: Callable[[Any, Sequence[int | str]], str] | None = None,
    error: type[TubePlannerError] = ProblemError,
) -> _Section:
    """Check nested dictionaries and lists against a model, and return the model's fields.

    Messages name the document, or the source of a value by the data and the keys that lead to it.
    """
    if not isinstance(data, dict):
        raise error(f"{source}: {model.what}")
    try:
        return model.model_validate(data)
    except ValidationError as report:
        steps = _steps(data, _deepest(data, report)["loc"])
        origin = source if source_of is None else source_of(data, steps)
        raise error(f"{origin}: {_first_fault(data, report, model)}") from None

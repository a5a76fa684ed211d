"""What a class takes by keyword, as what may stand in a table of a plant file: one source for both."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, get_args, get_type_hints

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, WithJsonSchema, create_model
from serial.rs485 import RS485Settings

from rs485bus.plant.problems import Problems, instead

_STRICT = ConfigDict(extra="forbid", strict=True, arbitrary_types_allowed=True, protected_namespaces=())


@cache
def options_of(takes: Callable[..., Any], by_side: frozenset[str] = frozenset()) -> type[BaseModel]:
    """A model of the keywords of a class. Those in `by_side` are tuples of which a table holds one part."""
    function = takes.__init__ if inspect.isclass(takes) else takes
    hints = get_type_hints(function)
    fields: dict[str, Any] = {}
    for name, parameter in inspect.signature(takes).parameters.items():
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY:
            hint = hints.get(name, Any)
            fields[name] = (_in_toml(get_args(hint)[0] if name in by_side else hint), parameter.default)
    return create_model(getattr(takes, "__name__", "Options"), __config__=_STRICT, **fields)


def typed_options(takes: Callable[..., Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Options as they stand in TOML, as a class takes them. Raises `ValueError`."""
    model = options_of(takes).model_validate(_tuples(options))
    return {name: getattr(model, name) for name in model.model_fields_set}


def _in_toml(hint: Any) -> Any:
    """A type as it is said in TOML: an enumeration by the name of its member."""
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        names = [member.name for member in hint]

        def member(value: Any) -> Any:
            if isinstance(value, hint):
                return value
            if isinstance(value, str) and value.upper() in names:
                return hint[value.upper()]
            raise ValueError(f"must be one of {', '.join(names)}, not {value!r}")

        schema = {"type": "string", "enum": names}
        return Annotated[hint, BeforeValidator(member), WithJsonSchema(schema)]
    if RS485Settings in get_args(hint):

        def settings(value: Any) -> Any:
            try:
                return RS485Settings(**value) if isinstance(value, Mapping) else value
            except TypeError as error:
                raise ValueError(f"{error}; see serial.rs485.RS485Settings") from None

        schema = {"type": ["boolean", "object"]}
        return Annotated[hint, BeforeValidator(settings), WithJsonSchema(schema)]
    return hint


def validated(
    model: type[BaseModel], table: Mapping[str, Any], at: Sequence[str], problems: Problems, known: Sequence[str] = ()
) -> BaseModel | None:
    """A table as a model; None where it has mistakes, which are noted.

    Args:
        model: what it must be.
        table: what stands in the file.
        at: the keys that lead to it.
        problems: where mistakes are noted.
        known: keys that may stand there besides the model's.
    """
    try:
        return model.model_validate(_tuples(table))
    except ValidationError as error:
        for wrong in error.errors(include_url=False):
            field = [*at, *(str(part) for part in wrong["loc"] if isinstance(part, str) and "[" not in part)]
            problems.add(field[: len(at) + 1], _words(wrong, [*model.model_fields, *known]))
        return None


def _words(wrong: Any, known: Sequence[str]) -> str:
    """What pydantic found, as a person would say it."""
    kind, value = wrong["type"], wrong.get("input")
    name = str(wrong["loc"][0]) if wrong["loc"] else ""
    needed = {
        "int_type": "a whole number",
        "int_from_float": "a whole number",
        "float_type": "a number",
        "string_type": 'a text in quotes, like "this"',
        "bool_type": "true or false",
        "tuple_type": "a list in brackets, like [0.0, 120.0]",
        "dict_type": "a table",
    }
    if kind == "extra_forbidden":
        return f"there is no such key{instead(name, known)}"
    if (kind == "missing" and isinstance(wrong["loc"][-1], int)) or kind in ("too_long", "too_short"):
        return "must be a list of two values, like [0.0, 120.0]"  # no other list has a fixed length
    if kind == "missing":
        return f"it is missing; add a line {name} = ..."
    if kind in needed:
        return f"must be {needed[kind]}, not {_shown(value)}"
    text = str(wrong["msg"]).removeprefix("Value error, ")
    return text if text.startswith("must be") else f"{text}, not {_shown(value)}"


def _shown(value: Any) -> str:
    return "true" if value is True else "false" if value is False else repr(value)


def _tuples(value: Any) -> Any:
    """Lists as tuples, which is what the classes take."""
    if isinstance(value, list):
        return tuple(_tuples(part) for part in value)
    if isinstance(value, Mapping):
        return {str(key): _tuples(part) for key, part in value.items()}
    return value


def schema_of(*models: type[BaseModel]) -> dict[str, Any]:
    """The JSON schema of a table that holds the fields of some models."""
    properties: dict[str, Any] = {}
    required: list[str] = []
    for model in models:
        schema = model.model_json_schema()
        properties |= schema["properties"]
        required += schema.get("required", [])
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}

"""Writes `rs485bus/blocking/__init__.pyi` from the asynchronous classes: what type checkers and editors read.

python -m tests.blocking.stub
"""

from __future__ import annotations

import ast
import builtins
import functools
import importlib
import inspect
import textwrap
import typing
from collections.abc import Collection
from pathlib import Path
from types import FunctionType
from typing import Any

import rs485bus
from rs485bus.blocking import _ROOTS  # type: ignore[attr-defined] # the stub does not say it
from rs485bus.blocking import bus as face
from rs485bus.blocking.mirror import HIDDEN, lives, offered
from rs485bus.bus.bus import Bus

STUB = Path(face.__file__).parent / "__init__.pyi"
UNTYPED = {
    **dict.fromkeys(("left", "right"), "ZlacWheel"),
    **dict.fromkeys(("microsteps", "highest"), "int"),
    **{"counts_per_turn": "float", "start_rpm": "float", "name": "str", "state": "MoveState"},
}
"""Attributes whose type is not to be seen where they are set."""
_RENAMED = {
    "AsyncIterator": "Stream",
    "AsyncGenerator": "Stream",
    "AbstractAsyncContextManager": "AbstractContextManager",
}
_PROTOCOLS = {"BusMember": "Axis | Zlac8015d", "GroupAxis": "Axis"}
"""What the faces are that stand for what a protocol describes."""
_MADE = ("MksServo", "TlrStepper", "Zlac8015d", "DifferentialDrive", "AxisGroup")
"""What users make themselves."""
_MAKERS = {"mks": "MksServo", "tlr": "TlrStepper", "zlac": "Zlac8015d"}


@functools.cache
def names_of(module: str) -> dict[str, tuple[str, str]]:
    """Where each name of a module comes from, imports for type checkers included."""
    found = importlib.import_module(module)
    tree = ast.parse(inspect.getsource(found))
    names = {name: (module, name) for name in vars(found)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            names |= {alias.asname or alias.name: (node.module, alias.name) for alias in node.names}
    return names


@functools.cache
def tree_of(cls: type) -> ast.ClassDef:
    """The source of a class."""
    node = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(node, ast.ClassDef)
    return node


class Stub:
    """The text of the stub, class by class."""

    def __init__(self, classes: Collection[str] = (), attributes: Collection[str] = ()) -> None:
        self.untyped: list[str] = []
        self.attributes: set[str] = set(attributes)
        self._reserved = classes
        self._imports: dict[str, tuple[str, str]] = {}
        self._variables: dict[str, str] = {}
        self.classes: dict[str, type] = {}
        self._text: dict[str, str] = {}

    def make(self) -> str:
        """All of it."""
        for name in ("Bus", *_ROOTS):
            self._need(getattr(rs485bus, name))
        opening = self._function("rs485bus.blocking.bus", face.open_bus, "")
        self._plant()
        while missing := [name for name in self.classes if name not in self._text]:
            for name in missing:
                self._text[name] = self._class(self.classes[name])
        parts = [opening]
        order: list[type] = []
        for cls in sorted(self.classes.values(), key=lambda cls: cls.__name__):
            order += [base for base in reversed(cls.__mro__) if base in self.classes.values() and base not in order]
        parts += [self._text[cls.__name__] for cls in order]
        parts.append(self._plant())
        return "\n".join((*self._head(), "", *parts))

    def _head(self) -> list[str]:
        sources: dict[str, list[str]] = {}
        for alias, (module, name) in sorted(self._imports.items()):
            sources.setdefault(module, []).append(name if name == alias else f"{name} as {alias}")
        return [
            '"""The blocking face, as type checkers and editors read it.',
            "",
            "Written by `python -m tests.blocking.stub` from the asynchronous classes; a test holds it against them.",
            '"""',
            "",
            "from collections.abc import Iterator as _Iterator",
            "from types import TracebackType as _TracebackType",
            "from typing import Generic, Literal, Self, TypeVar, overload",
            *(f"from {module} import {', '.join(names)}" for module, names in sorted(sources.items())),
            "",
            *(f"{name} = {text}" for name, text in sorted(self._variables.items())),
            '_V = TypeVar("_V", covariant=True)',
            "",
            "class Stream(_Iterator[_V]):",
            '    """What comes one after the other. `close()` ends it; so does letting go of it."""',
            "    def __next__(self) -> _V: ...",
            "    def close(self) -> None: ...",
        ]

    def _need(self, cls: type) -> str:
        name = cls.__name__
        assert self.classes.setdefault(name, cls) is cls, f"two classes are called {name}"
        return name

    # Types

    def _type(self, annotation: str, module: str) -> str:
        tree = ast.parse(annotation, mode="eval").body
        return ast.unparse(self._translate(tree, module))

    def _translate(self, node: ast.expr, module: str) -> ast.expr:
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) in ("Coroutine", "Awaitable"):
            inner = node.slice.elts[-1] if isinstance(node.slice, ast.Tuple) else node.slice
            return self._translate(inner, module)
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Literal":
            return node
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            return self._translate(ast.parse(node.value, mode="eval").body, module)
        if isinstance(node, ast.Name):
            return ast.Name(self._name(node.id, module))
        if isinstance(node, ast.Attribute):
            owner = importlib.import_module(module)
            value = functools.reduce(getattr, ast.unparse(node).split("."), owner)
            return ast.Name(self._import(value.__name__, value.__module__, value.__name__))
        for field, value in ast.iter_fields(node):
            if isinstance(value, ast.expr):
                setattr(node, field, self._translate(value, module))
            elif isinstance(value, list):
                setattr(node, field, [self._translate(v, module) if isinstance(v, ast.expr) else v for v in value])
        return node

    def _name(self, name: str, module: str) -> str:
        if name in ("Self", "Literal") or (hasattr(__builtins__, name) or name in dir(__import__("builtins"))):
            return name
        if name in _RENAMED:
            new = _RENAMED[name]
            return new if new == "Stream" else self._import(new, "contextlib", new)
        if name in _PROTOCOLS:
            return _PROTOCOLS[name]
        source, original = names_of(module)[name]
        value = getattr(importlib.import_module(source), original)
        if isinstance(value, typing.TypeVar):
            bound = "" if value.__bound__ is None else f", bound={self._type(_text(value.__bound__), source)}"
            self._variables[name] = f'TypeVar("{name}"{bound})'
            return name
        if value is face.Bus:
            return self._need(Bus)
        if name == "Plant":
            return name
        if isinstance(value, type) and lives(value):
            return self._need(value)
        return self._import(name, source, original)

    def _import(self, name: str, module: str, original: str) -> str:
        origin = getattr(importlib.import_module(module), original, None)
        for number in range(1, 9):
            alias = name if number == 1 else f"{name}{number}"
            known = self._imports.get(alias)
            if alias in self._reserved:
                continue
            if known is None or getattr(importlib.import_module(known[0]), known[1], None) is origin:
                self._imports.setdefault(alias, (module, original))
                return alias
        raise AssertionError(name)

    # Members

    def _class(self, cls: type) -> str:
        node = tree_of(cls)
        bases = [
            ast.unparse(self._translate(base, cls.__module__))
            for base in node.bases
            if _is_generic(base) or lives(_base(base, cls))
        ]
        own = [base for base in cls.__mro__ if base is cls or (_ours(base) and not lives(base))]
        lines = [f"class {cls.__name__}{'(' + ', '.join(bases) + ')' if bases else ''}:"]
        docs = face.Bus.__doc__ if cls is Bus else cls.__doc__
        lines += _docs(docs, "    ")
        attributes: dict[str, str] = {}
        for base in reversed(own):
            attributes |= self._attributes(base, cls)
        self.attributes |= set(attributes)
        lines += [f"    {name}: {kind}" for name, kind in attributes.items()]
        if cls is Bus:
            lines += self._makers()
        elif cls.__name__ in _MADE:
            init = next(base for base in cls.__mro__ if "__init__" in vars(base))
            lines.append(self._function(init.__module__, vars(init)["__init__"], "    "))
        lines += [text for name in offered(cls) if (text := self._member(cls, name))]
        if "__aenter__" in vars(cls):
            entered = inspect.signature(vars(cls)["__aenter__"]).return_annotation
            kind = "Self" if entered in ("Self", cls.__name__) else self._type(_text(entered), cls.__module__)
            lines.append(f"    def __enter__(self) -> {kind}: ...")
            lines += _EXIT
        if "__aiter__" in vars(cls):
            lines.append("    def __iter__(self) -> Self: ...")
        if len(lines) == 1:
            lines.append("    pass")
        return "\n".join(lines) + "\n"

    def _member(self, cls: type, name: str) -> str:
        member = inspect.getattr_static(cls, name)
        module = next(base.__module__ for base in cls.__mro__ if name in vars(base))
        if name == "wait" and hasattr(cls, "__await__"):
            result = inspect.signature(member).return_annotation
            from rs485bus.blocking.waiting import wait

            head = f"    def wait(self, timeout: float | None = None) -> {self._type(_text(result), module)}:"
            return "\n".join((head, *_docs(wait.__doc__, " " * 8), "        ..."))
        if isinstance(member, property) and name in self.attributes:
            return (
                f"    {name}: {self._type(_text(inspect.signature(member.fget or object).return_annotation), module)}"
            )
        if isinstance(member, property):
            getter = self._function(module, member.fget, "    ", name)
            return f"    @property\n{getter}"
        if isinstance(member, FunctionType):
            variants = typing.get_overloads(member)
            if variants:
                return "\n".join(f"    @overload\n{self._function(module, one, '    ')}" for one in variants)
            return self._function(module, member, "    ", name)
        kind = UNTYPED.get(name) or type(member).__name__
        return f"    {name}: {kind}" if type(member) in (bool, int, float, str) else ""

    def _function(self, module: str, function: Any, indent: str, name: str = "") -> str:
        signature = inspect.signature(function)
        parameters = []
        star = False
        for parameter in signature.parameters.values():
            if parameter.kind is parameter.KEYWORD_ONLY and not star:
                parameters.append("*")
                star = True
            text = parameter.name
            if parameter.kind is parameter.VAR_POSITIONAL:
                text, star = f"*{text}", True
            elif parameter.kind is parameter.VAR_KEYWORD:
                text = f"**{text}"
            if parameter.annotation is not parameter.empty:
                text += f": {self._type(_text(parameter.annotation), module)}"
            if parameter.default is not parameter.empty:
                default = parameter.default
                plain = default is None or type(default) in (bool, int, float, str)
                text += f" = {default!r}" if plain else " = ..."
            parameters.append(text)
        returns = "None"
        if signature.return_annotation is not signature.empty:
            returns = self._type(_text(signature.return_annotation), module)
        head = f"{indent}def {name or function.__name__}({', '.join(parameters)}) -> {returns}:"
        return "\n".join((head, *_docs(function.__doc__, indent + "    "), f"{indent}    ..."))

    def _plant(self) -> str:
        """The plant, which has a face of its own: its axes are known when its file is read."""
        from rs485bus.blocking.plant import Plant

        lines = ["class Plant:", *_docs(Plant.__doc__, "    ")]
        lines += [
            self._function(Plant.__module__, vars(Plant)[name], "    ") for name in ("__init__", "emergency_stop")
        ]
        lines += ["    @classmethod", self._function(Plant.__module__, vars(Plant)["load"].__func__, "    ")]
        lines += ["    def __getattr__(self, name: str) -> Any: ...", "    def __enter__(self) -> Self: ...", *_EXIT]
        return "\n".join(lines).replace("-> Plant", "-> Self") + "\n"

    def _makers(self) -> list[str]:
        """What a blocking bus has of its own."""
        lines = []
        for maker, family in _MAKERS.items():
            cls = getattr(rs485bus, family)
            init = next(base for base in cls.__mro__ if "__init__" in vars(base))
            text = self._function(init.__module__, vars(init)["__init__"], "    ", maker)
            head = text.splitlines()[0].replace("self, bus: Bus, ", "self, ").replace(" -> None:", f" -> {family}:")
            docs = _docs(getattr(face.Bus, maker).__doc__, " " * 8)
            lines += [head, *docs, "        ..."]
            self._need(cls)
        for name in ("group", "vehicle", "timeline", "close"):
            text = self._function("rs485bus.blocking.bus", getattr(face.Bus, name), "    ")
            lines.append(
                text.replace("-> Any", {"group": "-> AxisGroup", "vehicle": "-> DifferentialDrive"}.get(name, "-> Any"))
                .replace("axes: Face", "axes: Axis")
                .replace("zlac: Face", "zlac: Zlac8015d")
            )
        self._imports.pop("Face", None)
        lines += ["    def __enter__(self) -> Self: ...", *_EXIT]
        return lines

    def _attributes(self, base: type, cls: type) -> dict[str, str]:
        """The public attributes that a class sets in `__init__`, or declares."""
        found: dict[str, str] = {}
        for statement in tree_of(base).body:
            if isinstance(statement, ast.AnnAssign) and statement.value is None:
                name = ast.unparse(statement.target)
                if _public(name):
                    found[name] = UNTYPED.get(name) or self._type(ast.unparse(statement.annotation), base.__module__)
        init = next((n for n in tree_of(base).body if isinstance(n, ast.FunctionDef) and n.name == "__init__"), None)
        for node in ast.walk(init) if init is not None else ():
            if isinstance(node, ast.AnnAssign):
                targets, value = [node.target], node.annotation
            elif isinstance(node, ast.Assign):
                targets = [
                    t for group in node.targets for t in (group.elts if isinstance(group, ast.Tuple) else [group])
                ]
                value = node.value
            else:
                continue
            for target in targets:
                text = ast.unparse(target)
                name = text.removeprefix("self.")
                if text == name or "." in name or not _public(name) or isinstance(vars(base).get(name), property):
                    continue
                if isinstance(node, ast.AnnAssign):
                    found[name] = self._type(ast.unparse(value), base.__module__)
                else:
                    assert init is not None
                    kind = self._inferred(value, init, base.__module__)
                    told = UNTYPED.get(name, "")
                    known = told in dir(builtins) or told in names_of(base.__module__)
                    if known and (kind is None or told == "float"):
                        kind = self._name(UNTYPED[name], base.__module__)
                    if kind is None:
                        self.untyped.append(f"{base.__module__}.{base.__name__}.{name}")
                    else:
                        found[name] = kind
        return found

    def _inferred(self, value: ast.expr, init: ast.FunctionDef, module: str) -> str | None:
        if isinstance(value, ast.Constant):
            return None if value.value is None else type(value.value).__name__
        if isinstance(value, ast.JoinedStr):
            return "str"
        if isinstance(value, ast.Name):
            arguments = (*init.args.args, *init.args.kwonlyargs)
            annotation = next((a.annotation for a in arguments if a.arg == value.id), None)
            return None if annotation is None else self._type(ast.unparse(annotation), module)
        if isinstance(value, ast.IfExp) and isinstance(value.body, ast.Constant) and value.body.value is None:
            kind = self._inferred(value.orelse, init, module)
            return None if kind is None else f"{kind} | None"
        if isinstance(value, ast.Call) and isinstance(value.func, ast.Name):
            source, original = names_of(module).get(value.func.id, (module, value.func.id))
            called = getattr(importlib.import_module(source), original, None)
            if isinstance(called, type):
                return self._name(value.func.id, module)
            if isinstance(called, FunctionType) and isinstance(called.__annotations__.get("return"), str):
                given = [self._inferred(argument, init, module) for argument in value.args[1:]]
                if len(called.__annotations__["return"]) == 1:  # a type variable: what it is given, checked
                    return next((kind for kind in given if kind is not None), None)
                return self._type(called.__annotations__["return"], called.__module__)
        return None


_EXIT = [
    "    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, "
    "trace: _TracebackType | None) -> Literal[False] | None: ..."
]


def _text(annotation: Any) -> str:
    return annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)


def _is_generic(base: ast.expr) -> bool:
    return ast.unparse(base).startswith("Generic[")


def _base(node: ast.expr, cls: type) -> type:
    name = ast.unparse(node.value if isinstance(node, ast.Subscript) else node)
    return next((base for base in cls.__mro__ if base.__name__ == name.split(".")[-1]), object)


def _ours(cls: type) -> bool:
    return cls.__module__.startswith("rs485bus.")


def _public(name: str) -> bool:
    return not name.startswith("_") and name not in HIDDEN


def _docs(text: str | None, indent: str) -> list[str]:
    if not text:
        return []
    lines = inspect.cleandoc(text).splitlines()
    if len(lines) == 1:
        return [f'{indent}"""{lines[0]}"""']
    return [f'{indent}"""{lines[0]}', *(f"{indent}{line}".rstrip() for line in lines[1:]), f'{indent}"""']


def text() -> tuple[str, list[str]]:
    """The stub as it should be, and the attributes whose type is not to be seen."""
    first = Stub()
    first.make()
    stub = Stub(first.classes, first.attributes)
    return stub.make(), stub.untyped


if __name__ == "__main__":
    made, untyped = text()
    assert not untyped, f"annotate where they are set: {', '.join(untyped)}"
    STUB.write_text(made)

"""Options that several commands have: written once as a dataclass, one field each, and given to a command as one value.

``Annotated[PageOptions, Together()]`` on a parameter stands for the options of all fields of ``PageOptions``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import Enum
from functools import wraps
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from quasirigid.cli.options import (
    HOST,
    PORT,
    AllowOrigin,
    Browser,
    Compliance,
    ComplianceModel,
    Friction,
    Host,
    Mass,
    MaterialName,
    Motion,
    ObjectFile,
    ObjectMotion,
    Points,
    Port,
    Rotate,
    Scale,
    Seed,
    Size,
    Squeeze,
    Support,
    Threads,
    TimeStep,
    Up,
)

if TYPE_CHECKING:
    from quasirigid.grasp.options import GraspOptions


@dataclass(frozen=True)
class Together:
    """Marks a parameter of a command that stands for the fields of its type, ``without`` some, which keep their defaults."""

    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class GraspChoice:
    """What is chosen about a grasp: the fields of ``GraspOptions``, without ``hold``, which one command has alone."""

    object: ObjectFile = None
    scale: Scale = None
    size: Size = None
    up: Up = "z"
    rotate: Rotate = None
    mass: Mass = None
    points: Points = None
    friction: Friction = None
    material: MaterialName = "wood"
    squeeze: Squeeze = None
    compliance: ComplianceModel = Compliance.gaussian
    object_motion: Motion = ObjectMotion.inertial
    support: Support = None
    dt: TimeStep = 1e-3
    threads: Threads = 1
    seed: Seed = 0

    def options(self, **others: Any) -> GraspOptions:
        """The same for the library, with ``others`` beside."""
        from quasirigid.grasp.options import GraspOptions

        chosen = {field.name: getattr(self, field.name) for field in fields(self)}
        return GraspOptions(**{name: value.value if isinstance(value, Enum) else value for name, value in chosen.items()}, **others)


@dataclass(frozen=True)
class PageOptions:
    """Where a page is served, who may look, and whether a browser opens it."""

    host: Host = HOST
    port: Port = PORT
    allow_origin: AllowOrigin = None
    browser: Browser = True

    @property
    def allow_origins(self) -> tuple[str, ...]:
        """Pages to trust beside the own ones."""
        return tuple(self.allow_origin or ())


def expanded(function: Callable[..., Any]) -> Callable[..., Any]:
    """A command whose parameters marked with ``Together`` are replaced by the options that they stand for."""
    hints = get_type_hints(function, include_extras=True)
    parameters: list[inspect.Parameter] = []
    groups: dict[str, tuple[type, list[str]]] = {}

    def add(name: str, annotation: Any, default: Any) -> None:
        parameters.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default))

    for parameter in inspect.signature(function).parameters.values():
        hint = hints[parameter.name]
        kind, *marks = get_args(hint) or (hint,)
        together = next((mark for mark in marks if isinstance(mark, Together)), None)
        if together is None:
            add(parameter.name, hint, parameter.default)
            continue
        types, chosen = get_type_hints(kind, include_extras=True), [f for f in fields(kind) if f.name not in together.without]
        groups[parameter.name] = kind, [field.name for field in chosen]
        for field in chosen:
            add(field.name, types[field.name], field.default)

    @wraps(function)
    def run(**given: Any) -> Any:
        values = {name: kind(**{field: given.pop(field) for field in names}) for name, (kind, names) in groups.items()}
        return function(**given, **values)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


__all__ = ["GraspChoice", "PageOptions", "Together", "expanded"]

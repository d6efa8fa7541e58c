"""Arrays that are copies of what a world or a value holds: they can be read like any array, but not changed in place, for nobody would
notice.

>>> import quasirigid as qr
>>> world = qr.World()
>>> world.gravity[2] = 0.0
Traceback (most recent call last):
quasirigid.errors.InvalidValueError: World.gravity: expected to be left as it is, for it is a copy, got a change in place; take a .copy(),
change that, and assign it: world.gravity = ...
>>> world.gravity *= 0.5
>>> world.gravity
array([ 0.   ,  0.   , -4.905])
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, NoReturn

import numpy as np

from quasirigid.errors import InvalidValueError

Array = np.ndarray[Any, np.dtype[Any]]

_INSTEAD = {
    "Body.position": "give it to body.set_pose(position), or to body.move_to(position) for a fixed body",
    "Body.quaternion": "give it to body.set_pose(body.position, quaternion), or to body.move_to for a fixed body",
    "Body.centre_of_mass": "move the body with body.set_pose",
    "Body.linear_velocity": "give it to body.set_velocity(linear, angular)",
    "Body.angular_velocity": "give it to body.set_velocity(linear, angular)",
    "Hand.position": "give it to hand.move_to(position)",
    "Hand.quaternion": "give it to hand.move_to(hand.position, quaternion)",
    "Hand.joint_positions": "assign it: hand.joint_positions = ...",
    "Hand.joint_velocities": "assign targets: hand.joint_targets = ...",
    "Hand.joint_targets": "assign it: hand.joint_targets = ...",
    "Hand.joint_torques": "assign targets: hand.joint_targets = ...",
    "Hand.link_poses": "assign joints: hand.joint_positions = ...",
    "World.gravity": "assign it: world.gravity = ...",
    "MassProperties.centre": "make other ones: MassProperties(mass, centre, inertia)",
    "MassProperties.inertia": "make other ones: MassProperties(mass, centre, inertia)",
    "Friction.direction": "make another one: Friction(static, direction=..., ratio=...)",
    "HandModel.lower_limits": "make another hand",
    "HandModel.upper_limits": "make another hand",
    "HandModel.pad_semi_axes": "make another hand",
    "HandModel.knuckles": "make another hand",
    "Calibration.position": "make another one: Calibration(position, quaternion)",
    "Calibration.quaternion": "make another one: Calibration(position, quaternion)",
}
"""By property: what to do with the changed copy."""

_ASSIGNABLE = {"Hand.joint_positions", "Hand.joint_targets", "World.gravity"}
"""Those with a setter: ``hand.joint_targets += 0.1`` makes new targets and assigns them."""


class StateArray(Array):
    """A copy of state. Every change in place raises ``InvalidValueError``; what is computed from it is a plain array of your own, and so is
    ``copy()``.
    """

    property_name: ClassVar[str]

    def _refuse(self) -> NoReturn:
        hint = f"take a .copy(), change that, and {_INSTEAD[self.property_name]}"
        raise InvalidValueError(self.property_name, "to be left as it is, for it is a copy", "a change in place", hint)

    def _check(self) -> None:
        if not self.flags.writeable:  # new memory, such as a selection of rows, may be written to
            self._refuse()

    def __setitem__(self, key: Any, value: Any) -> None:
        self._check()
        super().__setitem__(key, value)

    def fill(self, *args: Any, **options: Any) -> None:
        """Refused."""
        self._check()
        super().fill(*args, **options)

    def sort(self, *args: Any, **options: Any) -> None:
        """Refused."""
        self._check()
        super().sort(*args, **options)

    def partition(self, *args: Any, **options: Any) -> None:
        """Refused."""
        self._check()
        super().partition(*args, **options)

    def put(self, *args: Any, **options: Any) -> None:
        """Refused."""
        self._check()
        super().put(*args, **options)

    def copy(self, order: Any = "C") -> Any:
        """A plain array of your own."""
        return _plain(self).copy(order)

    def __copy__(self) -> Any:
        return _plain(self).copy()

    def __deepcopy__(self, memo: dict[int, Any] | None) -> Any:
        return _plain(self).copy()

    def astype(self, *args: Any, **options: Any) -> Any:
        """A plain array of your own."""
        return _plain(self).copy().astype(*args, **options)

    def __reduce_ex__(self, protocol: Any) -> Any:
        return _plain(self).copy().__reduce_ex__(protocol)

    def __repr__(self) -> str:
        return repr(_plain(self))

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: tuple[Any, ...] = (), **options: Any) -> Any:
        for target in (*out, *(inputs[:1] if method == "at" else ())):
            if isinstance(target, StateArray):
                target._check()
        if out:
            options["out"] = tuple(_plain(target) for target in out)
        result = getattr(ufunc, method)(*(_plain(value) for value in inputs), **options)
        return out[0] if len(out) == 1 and out[0] is not None else result

    def __array_function__(self, func: Any, types: Iterable[type], args: Any, options: Any) -> Any:
        result = super().__array_function__(func, types, args, options)
        return _plain(result) if isinstance(result, StateArray) and result.flags.writeable else result


def _plain(value: Any) -> Any:
    """The same memory as a plain array; anything else as it is."""
    return value.view(np.ndarray) if isinstance(value, StateArray) else value


class AssignableStateArray(StateArray):
    """With ``+=`` and the like as of Python's own immutable types: they make a new array, which the property then takes."""

    def _new(self, operator: str, other: Any) -> Any:
        return getattr(_plain(self), operator)(_plain(other))


def _in_place(operator: str) -> Any:
    return lambda self, other: self._new(operator, other)


for _name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow"):
    setattr(AssignableStateArray, f"__i{_name}__", _in_place(f"__{_name}__"))


def _class_of(name: str) -> type[StateArray]:
    base = AssignableStateArray if name in _ASSIGNABLE else StateArray
    return type(base.__name__, (base,), {"property_name": name, "__module__": __name__, "__doc__": base.__doc__})


CLASSES = {name: _class_of(name) for name in _INSTEAD}
"""By property: the class of what it returns. The compiled module looks here."""

__all__ = ["CLASSES", "StateArray"]

"""Attributes that nothing would read are refused where they are set."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from esaac._native import SensorModel

PARAMETERS = frozenset(name for name, *_ in SensorModel.parameters())


class KnownAttributes:
    """Cameras whose parameters are their sensors'. What the class has may be set, and names that begin with `_`. A
    class of another package that inherits may have attributes of its own."""

    _OWN: ClassVar[tuple[str, ...]] = ()
    """More attributes that may be set."""

    _CHANGE: ClassVar[str]
    """How a parameter is changed."""

    # A type checker that sees it takes any name.
    if not TYPE_CHECKING:

        def __setattr__(self, name, value):
            kind = type(self)
            if not (name.startswith("_") or name in self._OWN or hasattr(kind, name)):
                if name in PARAMETERS:
                    how = self._CHANGE.format(name=name)
                    raise AttributeError(f"`{name}` is a parameter of the sensor, expected `{how}`")
                if kind.__module__.partition(".")[0] == "esaac":
                    how = self._CHANGE.format(name="contrast_on")
                    raise AttributeError(
                        f"{kind.__name__} has no attribute `{name}`; parameters are changed by `{how}`"
                    )
            super().__setattr__(name, value)

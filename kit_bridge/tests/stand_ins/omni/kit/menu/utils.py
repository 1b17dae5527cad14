"""Menus are lists of descriptions under a name."""

import dataclasses
from collections.abc import Callable

MENUS = {}


@dataclasses.dataclass
class MenuItemDescription:
    name: str
    glyph: str = ""
    onclick_fn: Callable | None = None


def add_menu_items(items, name):
    MENUS.setdefault(name, []).extend(items)


def remove_menu_items(items, name):
    MENUS[name] = [item for item in MENUS[name] if item not in items]

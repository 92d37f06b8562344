"""Change functions of a library module for one module under test, but not for threads of other tests."""

from __future__ import annotations

from types import ModuleType
from typing import Any


def changed_module(library: ModuleType, **changes: Any) -> ModuleType:
    """Return a module with the contents of `library`, in which some names have other values.

    The test puts the result in place of the module `library` that the module under test imports.
    """
    changed = ModuleType(library.__name__)
    vars(changed).update(vars(library), **changes)
    return changed

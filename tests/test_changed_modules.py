"""No test changes a function that threads of other tests in the same process call."""

from __future__ import annotations

import ast
import asyncio
import time
from pathlib import Path

from tests.shared.changed_module import changed_module

TESTS = Path(__file__).parent
# The server of the live page and emulated instruments run in threads until the end of all tests. They call these.
CALLED_BY_THREADS = {"asyncio": None, "time": {"sleep", "monotonic"}}  # None: every function


def changed_functions(text: str) -> list[str]:
    # Return the functions of `CALLED_BY_THREADS` that `monkeypatch.setattr(module, name, ...)` changes, as module.name.
    changes = []
    for call in ast.walk(ast.parse(text)):
        if not (isinstance(call, ast.Call) and ast.unparse(call.func).endswith(".setattr") and len(call.args) > 1):
            continue
        target, name = (ast.unparse(argument).strip("'\"") for argument in call.args[:2])
        is_text = isinstance(call.args[0], ast.Constant)
        module, _, function = (target if is_text else f"{target}.{name}").rpartition(".")
        module = module.rpartition(".")[2]
        if module in CALLED_BY_THREADS and function in (CALLED_BY_THREADS[module] or {function}):
            changes.append(f"{module}.{function}")
    return changes


def test_each_test_changes_functions_only_for_the_module_that_it_tests() -> None:
    changes = {path.relative_to(TESTS): changed_functions(path.read_text("utf-8")) for path in TESTS.rglob("*.py")}
    assert {path: names for path, names in changes.items() if names} == {}, "use tests.shared.changed_module"


def test_each_form_of_a_change_is_noticed() -> None:
    forms = 'm.setattr(time, "sleep", f); m.setattr(a.b.asyncio, "x", f); m.setattr(desk, "asyncio", f)'
    assert changed_functions(forms) == ["time.sleep", "asyncio.x"]
    assert changed_functions('m.setattr("time.sleep", f); m.setattr(time, "time", f)') == ["time.sleep"]


def test_a_changed_module_leaves_the_library_unchanged() -> None:
    changed = changed_module(time, sleep=len)
    assert changed.sleep is len
    assert changed.monotonic is time.monotonic
    assert time.sleep is not len
    assert changed_module(asyncio).run is asyncio.run

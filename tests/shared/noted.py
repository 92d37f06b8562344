"""Stand-ins that note how they are called."""

from __future__ import annotations

from typing import Any


class Noted:
    # An object whose methods are noted in `calls` and answer as given; other attributes have the given values.

    def __init__(self, calls: list[Any], name: str, **answers: Any) -> None:
        self._calls, self._name, self._answers = calls, name, answers

    def __getattr__(self, name: str) -> Any:
        answer = self.__dict__["_answers"].get(name, lambda *_, **__: None)
        return noted(self._calls, f"{self._name}.{name}", answer) if callable(answer) else answer


def noted(calls: list[Any], name: str, answer: Any = None) -> Any:
    # Return a function that notes its name and its arguments in `calls`, and answers as given.
    def call(*given: Any, **named: Any) -> Any:
        calls.append((name, *given, *named.items()))
        return answer(*given, **named) if callable(answer) else answer

    return call

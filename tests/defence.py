"""What `tests.defences` takes out."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Defence:
    """What is defended against, the code that does, what stands there without it, and the test that sees it."""

    against: str
    file: str
    code: str
    without: str
    test: str

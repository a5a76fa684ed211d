"""What the guide prints about the service."""

from __future__ import annotations

import re
from pathlib import Path

import rs485bus

PAGE = (Path(rs485bus.__file__).parent / "guide" / "service.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """The blocks of code in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


ACCESS_LIST = next(block for block in blocks("conf") if block.startswith("user service"))

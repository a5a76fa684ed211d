"""The command `rs485bus`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command, or say what it needs."""
    try:
        from rs485bus.cli.app import app
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.split(".")[0] not in ("typer", "rich", "click"):
            raise
        print(
            f"The command rs485bus needs the package {missing.name}, which is not installed. Install it with:\n"
            '    pip install "rs485bus[cli]"',
            file=sys.stderr,
        )
        sys.exit(1)
    app()

"""What gives a user the right to open a serial port, in words. On Linux a group has it: of Debian's, `dialout`."""

from __future__ import annotations

import os

try:
    import grp
    import pwd
except ImportError:  # Windows, where nobody needs it
    grp = pwd = None  # type: ignore[assignment]

_USUAL = "dialout"
_GROUP_MAY = 0o060


def how_to_be_allowed(path: str) -> str:
    """What somebody is to do who may not open a port."""
    join = f"join the group that owns it, then log in again: sudo usermod -aG {_USUAL} $USER"
    try:
        status = os.stat(path)
        group = grp.getgrgid(status.st_gid)
        owner, user = pwd.getpwuid(status.st_uid).pw_name, pwd.getpwuid(os.getuid()).pw_name
    except (AttributeError, KeyError, OSError):
        return join
    if status.st_mode & _GROUP_MAY != _GROUP_MAY or status.st_gid == 0:
        return (
            f"only {owner} may. Give it to a group, until it is plugged in again, and {join} "
            f"(sudo chgrp {_USUAL} {path}; sudo chmod g+rw {path})"
        )
    if user in group.gr_mem and status.st_gid not in os.getgroups():
        return f"you have joined its group, {group.gr_name}, since you logged in: log out, and in again"
    return join.replace(_USUAL, group.gr_name)

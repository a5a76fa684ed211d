"""The defences of all families of drives, for `tests.defences`."""

from __future__ import annotations

from tests.defences_of_mks import MKS
from tests.defences_of_tlr import TLR
from tests.defences_of_zlac import ZLAC

DRIVES = [*MKS, *ZLAC, *TLR]

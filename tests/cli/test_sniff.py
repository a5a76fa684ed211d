"""What `rs485bus sniff` says where there is nothing to be heard, or nothing to be understood; in virtual time."""

from __future__ import annotations

import asyncio
import random

import pytest

from rs485bus.cli.sniff import Listening
from rs485bus.errors import PortError
from rs485bus.sim import SimUnit, VirtualLine
from rs485bus.transport.interface import Sink
from tests.integration.support import virtual


class Pair(VirtualLine):
    """A pair on which somebody else may say something."""

    async def open(self, sink: Sink) -> None:
        self.sink = sink
        await super().open(sink)


@virtual
async def test_a_pair_on_which_nothing_is_heard_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    await Listening(Pair(SimUnit(1, {0: 1})), {}).listen(6.0)
    assert "Nothing was heard on virtual line for 5 s." in capsys.readouterr().err


@virtual
async def test_bytes_without_a_frame_are_a_wrong_rate_or_swapped_wires(capsys: pytest.CaptureFixture[str]) -> None:
    pair = Pair(SimUnit(1, {0: 1}), baudrate=9600)
    listening = asyncio.ensure_future(Listening(pair, {}).listen(6.0))
    await asyncio.sleep(1)
    pair.sink.received(random.Random(1).randbytes(40))
    await listening
    said = capsys.readouterr().err
    assert "40 bytes were heard, and no frame among them: the baud rate is not 9600" in said
    assert "A and B are swapped" in said


@virtual
async def test_a_port_that_is_lost_ends_it() -> None:
    pair = Pair(SimUnit(1, {0: 1}))
    listening = asyncio.ensure_future(Listening(pair, {}).listen(None))
    await asyncio.sleep(1)
    pair.unplug()
    with pytest.raises(PortError, match="was lost"):
        await listening

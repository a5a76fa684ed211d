"""How a request ended is told truly, by every face."""

import asyncio

import pytest

from rs485bus import BusConfig, Repeat, open_bus
from rs485bus.compat import BusClient
from rs485bus.errors import DeviceRefused, NoReply, OutcomeUnknown
from rs485bus.sim import VirtualLine
from tests.bus.oracle import DEAF, LOST, Oracle, does_and_says, refuses
from tests.integration.support import virtual

NO_ECHO = BusConfig(echo=False)


@virtual
async def test_a_verified_write_ends_in_its_time() -> None:
    """The unit answers no write, and no read-back either: both are tried as long as there is time."""
    unit = Oracle(1, *100 * [DEAF])
    async with open_bus(VirtualLine(unit), config=NO_ECHO) as bus:
        begun = bus.now()
        with pytest.raises(OutcomeUnknown, match="Nobody knows whether it was done"):
            await bus.unit(1).write_register(3, 7, repeat=Repeat.VERIFY, timeout=0.3)
        assert bus.now() - begun <= 0.3 + 0.11
        await asyncio.sleep(20)
        assert unit.writes == []
        assert max(record.sent_at for record in bus.flight if record.request[1] == 6) < begun + 0.3


@pytest.mark.parametrize("script", [[LOST, *3 * [DEAF]], [LOST, refuses(2)], [LOST, *3 * [refuses(11)]]])
@virtual
async def test_what_keeps_it_from_being_read_back_is_not_taken_for_its_outcome(script: list[object]) -> None:
    unit = Oracle(1, *script)  # type: ignore[arg-type]
    async with open_bus(VirtualLine(unit), config=NO_ECHO) as bus:
        with pytest.raises(OutcomeUnknown) as unknown:
            await bus.unit(1).write_registers(3, [7, 8], repeat=Repeat.VERIFY)
        assert unknown.value.request[1] == 16
        assert "safely" not in str(unknown.value)
        assert "othing was done" not in str(unknown.value)


@virtual
async def test_a_verified_write_that_was_carried_out_is_done_though_its_reply_was_lost() -> None:
    unit = Oracle(1, LOST)
    async with open_bus(VirtualLine(unit), config=NO_ECHO) as bus:
        await bus.unit(1).write_register(3, 7, repeat=Repeat.VERIFY)
    assert unit.times_written(3, 7) == 1


@virtual
async def test_the_error_has_the_code_of_the_exception_that_came() -> None:
    unit = Oracle(1, refuses(2), does_and_says(5), does_and_says(11), *3 * [refuses(10)], LOST)
    async with open_bus(VirtualLine(unit), config=NO_ECHO) as bus:
        ask = bus.unit(1)
        with pytest.raises(DeviceRefused) as refused:
            await ask.write_register(3, 7)
        with pytest.raises(OutcomeUnknown, match=r"still being carried out \(exception 05\)") as accepted:
            await ask.write_register(3, 7)
        with pytest.raises(OutcomeUnknown, match="the gateway says") as given_up:
            await ask.write_register(4, 7)
        with pytest.raises(NoReply, match="The gateway answers: check the device") as no_path:
            await ask.read_holding_registers(3)
        with pytest.raises(OutcomeUnknown) as lost:
            await ask.write_register(5, 7)
        errors = refused, accepted, given_up, no_path, lost
        assert [error.value.code for error in errors] == [2, 5, 11, 10, None]


@virtual
async def test_a_pymodbus_driver_is_given_the_exception_that_came() -> None:
    unit = Oracle(1, refuses(6), does_and_says(4), does_and_says(11), *3 * [refuses(11)])
    async with open_bus(VirtualLine(unit), config=NO_ECHO) as bus:
        client = BusClient(bus)
        answers = [
            await client.write_register(3, 7, device_id=1),
            await client.write_register(4, 7, device_id=1),
            await client.write_register(5, 7, device_id=1),
            await client.read_holding_registers(3, device_id=1),
        ]
        assert [answer.exception_code for answer in answers] == [6, 4, 11, 11]
        assert all(answer.isError() for answer in answers)

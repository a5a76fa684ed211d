"""A broadcast is checked, and what it sets in motion is known to move, whichever face sends it."""

from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest
from pymodbus.exceptions import ModbusException

from rs485bus import Bus, BusConfig, MksServo, TlrStepper, Urgency, Zlac8015d, open_bus
from rs485bus.compat import BroadcastRefused, BusClient
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import native
from rs485bus.errors import BroadcastConflict, EmergencyStopped
from rs485bus.sim import SimMks, SimTlr, SimUnit, SimZlac, VirtualLine
from rs485bus.wire.frames import Request, crc, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.integration.support import bus_on, plant, virtual

Face = Callable[[Bus, int, int], Awaitable[object]]


async def by_broadcast(bus: Bus, register: int, value: int) -> None:
    await bus.broadcast.write_register(register, value)


async def by_broadcast_of_several(bus: Bus, register: int, value: int) -> None:
    await bus.broadcast.write_registers(register, [value])


async def by_asking(bus: Bus, register: int, value: int) -> None:
    await bus.ask(write_single(0, register, value), repeat=Repeat.NEVER)


async def by_compat(bus: Bus, register: int, value: int) -> None:
    await BusClient(bus).write_register(register, value, device_id=0)


async def by_compat_in_silence(bus: Bus, register: int, value: int) -> None:
    await BusClient(bus).write_register(register, value, device_id=0, no_response_expected=True)


moving = [by_broadcast, by_asking, by_compat, by_compat_in_silence]


@pytest.mark.parametrize("face", [by_broadcast_of_several, *moving])
@virtual
async def test_one_that_a_second_family_would_act_on_is_refused(face: Face) -> None:
    sims = SimMks(1), SimTlr(2), SimZlac(3)
    async with open_bus(VirtualLine(*sims)) as bus:
        x, _, _ = MksServo(bus, 1), TlrStepper(bus, 2), Zlac8015d(bus, 3)
        await x.enable()
        before = len(bus.flight)
        with pytest.raises(BroadcastConflict, match="0x0091 means something to MKS and TL-R"):
            await face(bus, r.GO_HOME.address, 1)
        assert [record.outcome for record in bus.flight[before:]].count("broadcast") == 0


@virtual
async def test_a_pymodbus_driver_gets_it_as_what_cannot_be_asked() -> None:
    async with open_bus(VirtualLine(SimMks(1), SimTlr(2))) as bus:
        x, _ = MksServo(bus, 1), TlrStepper(bus, 2)
        await x.position()
        with pytest.raises(ModbusException, match="means something to"):
            await BusClient(bus).write_register(r.GO_HOME.address, 1, device_id=0)


@virtual
async def test_a_read_of_everyone_is_never_sent() -> None:
    unit = SimUnit(7, {register: register for register in range(8)})
    body = bytes((0, 3, 0, 0, 0, 1))
    request = Request(0, 3, body + crc(body), body[:2], 0, writes=False)
    async with open_bus(VirtualLine(unit)) as bus:
        await bus.unit(7).read_holding_registers(0)
        before = len(bus.flight)
        client = BusClient(bus)
        for ask in (
            lambda: client.read_holding_registers(0, device_id=0),
            lambda: client.read_coils(0, device_id=0),
            lambda: client.read_input_registers(0, device_id=0, no_response_expected=True),
            lambda: client.report_device_id(device_id=0),
        ):
            with pytest.raises(BroadcastRefused, match="Ask the devices one by one"):
                await ask()
        with pytest.raises(BroadcastConflict, match="Ask the devices one by one"):
            await bus.ask(request)
        assert len(bus.flight) == before
        with pytest.raises(ValueError, match="0"):
            bus.unit(0)


@pytest.mark.parametrize("face", moving)
@virtual
async def test_what_it_sets_in_motion_is_known_to_move_and_is_stopped(face: Face) -> None:
    """Leaving the block by an exception stops every axis that may move."""
    made = plant(2)
    with suppress(RuntimeError):
        async with bus_on(made) as (bus, axes):
            for axis in axes:
                await axis.enable()
            await face(bus, r.GO_HOME.address, 1)
            assert not made.stands()
            assert all(axis.motion.may_move for axis in axes)
            raise RuntimeError("the application fails")
    assert made.stands()


@pytest.mark.parametrize("face", moving)
@virtual
async def test_one_that_moves_is_refused_while_the_bus_is_latched(face: Face) -> None:
    made = plant(1)
    async with bus_on(made) as (bus, (x,)):
        await x.enable()
        await bus.emergency_stop()
        with suppress(EmergencyStopped, ModbusException):
            await face(bus, r.GO_HOME.address, 1)
        assert made.stands()
        assert not x.motion.may_move


@virtual
async def test_one_that_was_stopped_before_it_was_sent_is_not_sent() -> None:
    made = plant(2)
    async with bus_on(made) as (bus, (x, y)):
        await x.enable()
        await y.enable()
        bus.spawn(_ignored(bus.broadcast.write_register(r.GO_HOME.address, 1)), "broadcast")
        await y.stop()
        assert made.stands()


async def _ignored(asked: Awaitable[object]) -> None:
    with suppress(Exception):
        await asked


@virtual
async def test_a_frame_that_is_no_modbus_is_no_broadcast() -> None:
    """The drives' own protocol begins with another byte: no other family hears it."""
    async with open_bus(VirtualLine(SimMks(1), SimZlac(3)), config=BusConfig(echo=False)) as bus:
        MksServo(bus, 1), Zlac8015d(bus, 3)
        await bus.ask(native(1, r.MODBUS.address, 1), repeat=Repeat.NEVER, urgency=Urgency.COMMAND)
        with pytest.raises(BroadcastConflict):
            await bus.ask(write_multiple(0, 0x200D, [1, 2]), family="MKS")

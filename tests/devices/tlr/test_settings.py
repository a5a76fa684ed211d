"""What a drive is set to, keeps, and forgets (TL-R manual, 2.2, 3.5)."""

import asyncio
import functools

import pytest

from rs485bus import TlrStepper, open_bus
from rs485bus.devices.tlr import (
    SWITCHES,
    BaudRate,
    DiFunction,
    DoFunction,
    OperatingMode,
    PathMode,
    Ports,
    SerialFormat,
)
from rs485bus.devices.tlr import registers as r
from rs485bus.errors import (
    AddressInUse,
    DeviceRefused,
    LimitExceeded,
    NotStanding,
    NotSupported,
    OutcomeUnknown,
    ReferenceLost,
)
from rs485bus.sim import Dip, SimTlr, SimUnit, TlrMachine, VirtualLine
from rs485bus.wire.frames import crc
from rs485bus.wire.registers import Register
from tests.devices.tlr.support import TRIGGERS, lose, now, restart_at_once, stepper_on, writes
from tests.integration.support import virtual


async def power_cycle(sim: SimTlr) -> None:
    sim.power_cycle(now())
    await asyncio.sleep(1.0)


# Inputs and outputs


@virtual
async def test_inputs_have_functions_polarity_and_a_filter() -> None:
    sim = SimTlr(machine=TlrMachine(origin=None))
    async with stepper_on(sim) as x:
        assert [await x.inputs[port] for port in range(5)] == list(SWITCHES)
        x.inputs[3] = DiFunction.STOP
        assert await x.inputs.assign(*SWITCHES[:3], DiFunction.STOP) is None  # type: ignore[func-returns-value]
        assert await x.inputs[3] is DiFunction.STOP
        await x.inputs.set_polarity(3, normally_closed=True)
        assert await x.inputs.states() == (False, False, False, True, False)
        sim.close(3, True, now())
        assert await x.inputs.states() == (False,) * 5
        await x.inputs.set_polarity(3, normally_closed=False)
        assert (await x.status()).inputs == Ports.PORT_3
        await x.inputs.set_filter(1024)
        assert await x.read(r.INPUT_FILTER) == 1024
        with pytest.raises(LimitExceeded, match=r"0\.\.1024"):
            x.inputs.set_filter(1025)
        with pytest.raises(LimitExceeded, match="none of NONE"):
            x.inputs[0] = 7  # type: ignore[assignment] # the point of the test
        with pytest.raises(IndexError, match=r"5 is outside 0\.\.4"):
            x.inputs.set_polarity(5, normally_closed=True)
        with pytest.raises(LimitExceeded, match="6 functions for 5 inputs"):
            x.inputs.assign(*SWITCHES, DiFunction.STOP)


@virtual
async def test_all_five_inputs_are_assigned_where_blocks_of_five_are_truncated() -> None:
    sim = SimTlr(truncates=4)
    async with stepper_on(sim) as x:
        await x.inputs.assign(*[DiFunction.STOP] * 5)
        assert [await x.inputs[port] for port in range(5)] == [DiFunction.STOP] * 5


@pytest.mark.parametrize("function", [DiFunction.STOP, DiFunction.EMERGENCY_STOP, DiFunction.RELEASE])
@virtual
async def test_an_input_may_stop_it_or_keep_it_from_moving(function: DiFunction) -> None:
    sim = SimTlr(machine=TlrMachine(origin=None))
    async with stepper_on(sim) as x:
        x.enable()
        await x.inputs.set(4, function)
        move = x.move_to(50.0)
        await asyncio.sleep(1.0)
        sim.close(4, True, now())
        with pytest.raises(Exception, match=r"with inputs <Ports\.PORT_4: 16>"):
            await move
        with pytest.raises(DeviceRefused, match=r"execution denied.*an input that holds it.*\(exception 04\)"):
            await x.move_to(1.0)
        sim.close(4, False, now())
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_outputs_have_functions_polarity_and_can_be_forced() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        assert [await x.outputs[port] for port in range(2)] == [DoFunction.ALARM, DoFunction.NONE]
        x.outputs[0] = DoFunction.FORCED_2
        await x.outputs.set(1, DoFunction.IN_POSITION)
        assert await x.outputs.states() == (False, False)
        await x.outputs.force(2, True)
        await x.enable()
        await x.move_to(1.0)
        assert await x.outputs.states() == (True, True)
        await x.outputs.force(2, False)
        await x.outputs.set_polarity(1, normally_closed=True)
        assert await x.outputs.states() == (False, False)
        with pytest.raises(IndexError):
            x.outputs.force(4, True)
        for function in DoFunction:
            await x.outputs.set(1, function)
            assert await x.outputs[1] is function


# Counting


@virtual
async def test_another_subdivision_or_direction_ends_the_trust_in_positions() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        x.enable()
        await x.move_to(1.0)
        await x.set_subdivision(8000)
        with pytest.raises(ReferenceLost, match="subdivision was changed"):
            await x.move_to(2.0)
        await x.set_zero()
        assert await x.move_to(2.0) == 2.0
        assert x.counts_per_turn == 8000
        assert sim.shaft(now()) == pytest.approx(3.0)
        await x.set_direction(reverse=True)
        with pytest.raises(ReferenceLost, match="reversed direction was changed"):
            await x.move_by(1.0)
        await x.set_zero()
        await x.move_to(1.0)
        assert sim.shaft(now()) == pytest.approx(2.0)
        with pytest.raises(LimitExceeded, match=r"subdivision 399 pulses/turn is outside 400\.\.51200"):
            x.set_subdivision(399)


# What is kept


@TRIGGERS
@virtual
async def test_what_was_not_saved_is_gone_after_a_power_cycle(trigger: str) -> None:
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        await x.paths.set_mode(PathMode.ABSOLUTE)
        await power_cycle(sim)
        assert await x.read(r.PATH_MODE) is PathMode.RELATIVE
        for filtered in (5, 6):  # twice: the command must be taken again
            await x.inputs.set_filter(filtered)
            await x.save()
            await power_cycle(sim)
            assert await x.read(r.INPUT_FILTER) == filtered


@virtual
async def test_a_drive_that_restarts_before_it_has_saved_is_not_said_to_have_saved_what_was_set() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.inputs.set_filter(77)
        lose(sim, r.AUXILIARY.address, heard=False, value=0x0200, after=lambda _: restart_at_once(sim))
        with pytest.raises(ReferenceLost, match="set again what was set, save"):
            await x.save()


@virtual
async def test_a_factory_reset_ends_the_trust_in_everything() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        x.enable()
        await x.inputs.set_filter(77)
        await x.run(60)
        await x.factory_reset()
        assert not sim.moving(now())
        assert await x.read(r.INPUT_FILTER) == 2
        with pytest.raises(ReferenceLost, match="was reset"):
            await x.move_to(1.0)
        lose(sim, r.AUXILIARY.address, 9, heard=True, value=0x0100)
        with pytest.raises(OutcomeUnknown):
            await x.factory_reset()


@virtual
async def test_the_operating_mode_counts_after_a_power_cycle() -> None:
    sim = SimTlr(operating_mode=OperatingMode.CLOSED_LOOP)
    async with stepper_on(sim) as x:
        await x.set_operating_mode(OperatingMode.OPEN_LOOP)
        assert await x.read(r.OPERATING_MODE) is OperatingMode.OPEN_LOOP
        assert sim.motion.closed_loop
        await x.save()
        await power_cycle(sim)
        assert not sim.motion.closed_loop


# The line


@pytest.mark.parametrize("at_once", [False, True])
@virtual
async def test_a_station_counts_where_the_switches_are_off(at_once: bool) -> None:
    sim = SimTlr(20, serial_at_once=at_once)
    assert sim.dip == Dip(0)
    async with stepper_on(sim) as x:
        await x.set_station(33)
        if not at_once:
            await x.save()
            await power_cycle(sim)
        assert sim.address == 33
        assert await TlrStepper(x.bus, 33).read(r.STATION) == 33
        with pytest.raises(LimitExceeded, match=r"station 0 is outside 1\.\.247"):
            x.set_station(0)


@virtual
async def test_a_station_that_somebody_has_already_is_given_to_nobody() -> None:
    sim, others = SimTlr(20, serial_at_once=True), (SimTlr(33), SimUnit(34, {}))
    async with open_bus(VirtualLine(sim, *others)) as bus:
        x = TlrStepper(bus, 20)
        for station in (33, 34):
            with pytest.raises(AddressInUse, match="somebody answers"):
                await x.set_station(station)
        TlrStepper(bus, 35)  # it is away
        with pytest.raises(AddressInUse, match="has a facade"):
            x.set_station(35)
        assert not writes(sim, r.STATION.address)
        await x.set_station(20)
        await x.set_station(36)
        assert sim.address == 36


@virtual
async def test_a_motor_that_turns_is_not_made_deaf_to_its_stop() -> None:
    sim = SimTlr(20, serial_at_once=True)
    async with stepper_on(sim) as x:
        await x.enable()
        await x.run(60)
        for change in (lambda: x.set_station(33), lambda: x.set_baudrate(BaudRate.BAUD_19200)):
            with pytest.raises(NotStanding):
                await change()
        assert sim.address == 20
        await x.stop()


@virtual
async def test_a_station_whose_answer_is_lost_is_not_known_to_be_set() -> None:
    sim = SimTlr(20)
    async with stepper_on(sim) as x:
        lose(sim, r.STATION.address, heard=True)
        with pytest.raises(OutcomeUnknown):
            await x.set_station(33)


@virtual
async def test_a_baud_rate_counts_where_switch_5_is_on() -> None:
    sim = SimTlr(dip=Dip(1, custom_baudrate=True))
    async with stepper_on(sim) as x:
        await x.set_baudrate(BaudRate.BAUD_19200)
        await x.set_serial_format(SerialFormat.E1)
        await x.save()
        sim.power_cycle(now())
    await asyncio.sleep(1.0)
    assert sim.baudrate == 19200
    async with open_bus(VirtualLine(sim, baudrate=19200)) as bus:
        assert await TlrStepper(bus, 1).read(r.SERIAL_FORMAT) is SerialFormat.E1


# Any parameter


@virtual
async def test_any_setting_can_be_read_and_written_by_name() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.write(r.HOMING_SPEED, 120)
        assert await x.read(r.HOMING_SPEED) == 120
        await x.write(r.HOME_OFFSET, -70_000)
        assert await x.read(r.HOME_OFFSET) == -70_000


@virtual
async def test_what_the_manufacturer_has_set_is_guarded() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        with pytest.raises(NotSupported, match=r"current loop Kp \(0x10F\).*manufacturer=True"):
            x.write(r.CURRENT_LOOP_KP, 100)
        assert not sim.writes
        await x.write(r.CURRENT_LOOP_KP, 100, manufacturer=True)
        assert await x.read(r.CURRENT_LOOP_KP) == 100


@pytest.mark.parametrize(
    ("register", "verb"),
    [
        (r.CONTROL, "move_to"),
        (r.AUXILIARY, "move_to"),
        (r.SPEED, "move_to"),
        (r.TARGET, "move_to"),
        (r.SUBDIVISION, "set_subdivision"),
        (r.STATION, "set_station"),
        (r.INPUT_FUNCTIONS[1], "inputs"),
    ],
    ids=lambda case: getattr(case, "name", case),
)
@virtual
async def test_what_has_a_verb_is_not_written_behind_its_back(register: Register[int], verb: str) -> None:
    async with stepper_on(SimTlr()) as x:
        with pytest.raises(NotSupported, match=verb):
            x.write(register, 1)


@virtual
async def test_versions() -> None:
    async with stepper_on(SimTlr()) as x:
        version = await x.version()
        assert (version.software, version.hardware) == (0x0102, 0x0100)


@virtual
async def test_vendor_exceptions_have_their_names() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        for code, name in ((3, "illegal data"), (4, "execution denied")):
            receive = sim.receive
            sim.receive = functools.partial(_refuse, code)  # type: ignore[method-assign]
            with pytest.raises(DeviceRefused, match=f"TL-R 1 refuses, {name}.*exception 0{code}") as refused:
                await x.read(r.SPEED)
            assert refused.value.code == code
            sim.receive = receive  # type: ignore[method-assign]


def _refuse(code: int, frame: bytes, now: float) -> bytes:
    body = bytes((frame[0], frame[1] | 0x80, code))
    return body + crc(body)

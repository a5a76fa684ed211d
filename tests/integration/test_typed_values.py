"""Typed reads and writes of a unit: scaled, of any number, with as few requests as the device allows."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus import MksServo, Repeat, open_bus
from rs485bus.errors import DeviceRefused, LimitExceeded, NoReply, NotSent
from rs485bus.sim import ModbusData, SimMks, SimModbus, VirtualLine
from rs485bus.wire.combining import spans
from rs485bus.wire.registers import F32, F64, I16, I32, U8, U16, U32, Register
from tests.integration.support import virtual

TEMPERATURE: Register[float] = Register("temperature", I16, "°C", -40, 125, step=0.1, address=4)
HUMIDITY: Register[float] = Register("humidity", U16, "%", step=0.1, address=5)
POWER: Register[float] = Register("power", F32, "W", address=6)
ENERGY: Register[int] = Register("energy", U32, "Wh", word_order="little", address=8)
SERIAL: Register[int] = Register("serial number", U16, address=20, access="r")
RESET: Register[int] = Register("reset", U16, address=30, access="w")
MODE: Register[int] = Register("mode", U8, address=31)
INPUT: Register[float] = Register("input", F64, address=4, function=4)


def meter() -> SimModbus:
    registers = dict.fromkeys(range(64), 0)
    registers |= {4: 0x10000 - 55, 5: 423, 6: 0x4366, 7: 0x3334, 8: 0x0304, 9: 0x0102, 20: 4711, 31: 5}
    return SimModbus(7, ModbusData(registers=registers, input_registers={4: 0x3FF8, 5: 0, 6: 0, 7: 0}))


@virtual
async def test_a_value_comes_in_its_own_unit() -> None:
    async with open_bus(VirtualLine(meter())) as bus:
        unit = bus.unit(7)
        assert await unit.read(TEMPERATURE) == pytest.approx(-5.5)
        assert await unit.read(POWER) == pytest.approx(230.2)
        assert await unit.read(ENERGY) == 0x01020304
        assert await unit.read(INPUT) == 1.5
        assert await unit.read(MODE) == 5


@virtual
async def test_neighbours_come_with_one_request_in_the_order_asked_for() -> None:
    async with open_bus(VirtualLine(sim := meter())) as bus:
        unit = bus.unit(7)
        values = await unit.read(ENERGY, TEMPERATURE, SERIAL, HUMIDITY, INPUT, POWER)
        assert values == pytest.approx((0x01020304, -5.5, 4711, 42.3, 1.5, 230.2))
        assert [pdu.hex() for pdu in sim.asked] == ["0300040006", "0300140001", "0400040004"]
        sim.asked.clear()
        assert (await unit.read(HUMIDITY, SERIAL, gap=20))[1] == 4711
        assert [pdu.hex() for pdu in sim.asked] == ["0300050010"]
        sim.asked.clear()
        await unit.read(TEMPERATURE, HUMIDITY, combine=False)


@virtual
async def test_a_device_that_refuses_a_block_is_asked_for_each_value_from_then_on() -> None:
    async with open_bus(VirtualLine(sim := meter())) as bus:
        sim.data.largest_block = 2
        unit = bus.unit(7)
        assert await unit.read(TEMPERATURE, HUMIDITY, POWER) == pytest.approx((-5.5, 42.3, 230.2))
        assert len(sim.asked) == 4
        sim.asked.clear()
        assert await unit.read(TEMPERATURE, HUMIDITY, POWER) == pytest.approx((-5.5, 42.3, 230.2))
        assert len(sim.asked) == 3
        missing: Register[int] = Register("missing", U16, address=64)
        with pytest.raises(DeviceRefused, match="illegal register address"):
            await unit.read(missing)


@virtual
async def test_a_drive_whose_addresses_are_command_codes_is_asked_for_each_value() -> None:
    async with open_bus(VirtualLine(sim := SimMks(1))) as bus:
        MksServo(bus, 1)
        speed: Register[int] = Register("speed", I16, "rpm", address=0x32, function=4)
        pulses: Register[int] = Register("pulses", I32, address=0x33)  # the family knows by which function
        assert await bus.unit(1).read(speed, pulses) == (0, 0)
        assert [record.request[2:6].hex() for record in bus.flight[-2:]] == ["00320001", "00330002"]
        assert sim.address == 1


@virtual
async def test_a_value_is_written_in_its_own_unit() -> None:
    async with open_bus(VirtualLine(sim := meter())) as bus:
        unit = bus.unit(7)
        await unit.write(TEMPERATURE, 21.5)
        assert sim.asked[-1].hex() == "06000400d7"
        await unit.write(TEMPERATURE, -2, function=16)
        assert sim.asked[-1].hex() == "100004000102ffec"
        await unit.write(POWER, 1.0, repeat=Repeat.VERIFY)
        assert sim.asked[-1].hex() == "10000600020" + "43f800000"
        await unit.write(ENERGY, 5)
        assert (sim.data.registers[8], sim.data.registers[9]) == (5, 0)
        await unit.write(MODE, 200)
        assert sim.data.registers[31] == 200
        assert await unit.read(MODE) == 200


@virtual
async def test_what_cannot_be_is_told_before_anything_is_sent() -> None:
    async with open_bus(VirtualLine(meter())) as bus:
        unit = bus.unit(7)
        with pytest.raises(LimitExceeded, match=r"temperature 200 °C is outside -40\.\.125 °C"):
            await unit.write(TEMPERATURE, 200)
        with pytest.raises(ValueError, match="serial number cannot be written: its access is 'r'"):
            await unit.write(SERIAL, 1)
        with pytest.raises(ValueError, match="reset cannot be read: its access is 'w'"):
            await unit.read(TEMPERATURE, RESET)
        with pytest.raises(ValueError, match="input is an input register"):
            await unit.write(INPUT, 1.0)
        with pytest.raises(ValueError, match="power takes 2 registers: function 6 writes one"):
            await unit.write(POWER, 1.0, function=6)
        with pytest.raises(ValueError, match="function 5 is neither 6 nor 16"):
            await unit.write(HUMIDITY, 1.0, function=5)  # type: ignore[arg-type] # the point of the test
        with pytest.raises(TypeError, match=r'register must be made like Register\("temperature", I16'):
            await unit.read(4)  # type: ignore[call-overload] # the point of the test
        with pytest.raises(TypeError, match="takes one register or more"):
            await unit.read()
        assert bus.stats.transactions == 0


@virtual
async def test_the_time_is_for_all_requests_of_a_read() -> None:
    async with open_bus(VirtualLine(meter(), baudrate=1200)) as bus:
        began = bus.now()
        with pytest.raises((NotSent, NoReply), match=r"[Ii]ts time was over"):
            await bus.unit(7).read(TEMPERATURE, SERIAL, INPUT, timeout=0.3)
        assert bus.now() - began == pytest.approx(0.3)


wanted = st.lists(
    st.tuples(st.integers(0, 300), st.sampled_from([U16, U32, F64]), st.sampled_from([3, 4])), max_size=12
)


@given(wanted, st.integers(0, 20))
def test_each_value_is_read_whole_and_once_whatever_is_asked_for(
    places: list[tuple[int, object, int]], gap: int
) -> None:
    registers = [Register("x", number, address=at, function=code) for at, number, code in places]  # type: ignore[arg-type]
    made = spans(registers, combine=True, gap=gap)
    found = sorted(place for span in made for place, _ in span.members)
    assert found == list(range(len(registers)))
    for span in made:
        assert span.length <= 125
        for _, register in span.members:
            assert register.function == span.function
            assert span.first <= register.address
            assert register.address + register.count <= span.first + span.length

"""One drive alone on the pair gets an address, a baud rate, and Modbus; what is not certain says so."""

import itertools

import pytest

from rs485bus.devices.mks import BaudRate
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.provisioning import (
    Place,
    disable_modbus,
    enable_modbus,
    set_address,
    set_baud_rate,
)
from rs485bus.devices.mks.values import MotionDirection
from rs485bus.errors import AddressInUse, DeviceRefused, LimitExceeded, NoReply, NotStanding
from rs485bus.sim import Noise, SimMks, VirtualLine
from tests.devices.mks.bench import FlakyMks, on_virtual_clock


class Adapter:
    """An adapter that can be opened at any rate."""

    def __init__(self, *sims: SimMks) -> None:
        self.sims = sims
        self.rates: list[int] = []
        self.lines: list[VirtualLine] = []

    def __call__(self, baudrate: int) -> VirtualLine:
        self.rates.append(baudrate)
        line = VirtualLine(*self.sims, baudrate=baudrate)
        self.lines.append(line)
        return line

    def __del__(self) -> None:
        assert all(line.pair.early_frames == 0 for line in self.lines)


@pytest.mark.parametrize("at_new", [False, True])
@on_virtual_clock
async def test_an_address_is_confirmed_whether_it_is_answered_at_the_old_or_the_new_one(at_new: bool) -> None:
    sim = SimMks(1, baudrate=38400, answers_at_new=at_new)
    result = await set_address(Adapter(sim), 17)
    assert result.confirmed
    assert result.place == Place(17, 38400)
    assert sim.address == 17
    assert str(result) == "Confirmed: It answers: address 17 at 38400 bit/s."


@pytest.mark.parametrize("at_new", [False, True])
@pytest.mark.parametrize("code", list(BaudRate))
@on_virtual_clock
async def test_a_baud_rate_is_confirmed_whether_it_is_answered_at_the_old_or_the_new_one(
    code: BaudRate, at_new: bool
) -> None:
    sim = SimMks(3, baudrate=115200, answers_at_new=at_new)
    result = await set_baud_rate(Adapter(sim), code, address=3, baudrate=115200)
    assert result.confirmed
    assert result.place == Place(3, code.baudrate)
    assert sim.baudrate == code.baudrate


@on_virtual_clock
async def test_a_drive_that_has_the_new_setting_already_is_left_alone() -> None:
    adapter = Adapter(SimMks(17, baudrate=38400))
    result = await set_address(adapter, 17)
    assert result.confirmed
    assert "already" in result.message
    sim = SimMks(1, baudrate=115200)
    result = await set_baud_rate(Adapter(sim), BaudRate.BAUD_115200)
    assert result.confirmed
    assert result.place == Place(1, 115200)


@on_virtual_clock
async def test_a_new_setting_that_counts_only_after_a_power_cycle_is_not_confirmed() -> None:
    sim = SimMks(1, baudrate=38400)
    sim._change = lambda name, value, now: None  # type: ignore[method-assign] # it takes effect later
    for result in (await set_address(Adapter(sim), 17), await set_baud_rate(Adapter(sim), BaudRate.BAUD_9600)):
        assert not result.confirmed
        assert result.place == Place(1, 38400)
        assert "acknowledged the change and still answers: address 1 at 38400 bit/s. Switch it off" in str(result)
        assert str(result).startswith("NOT CONFIRMED")


@on_virtual_clock
async def test_a_drive_that_takes_a_moment_to_change_is_given_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rs485bus.sim.mks._NEW_SETTING_TAKES", 0.45)
    assert (await set_address(Adapter(SimMks(1, baudrate=38400)), 17)).confirmed


@on_virtual_clock
async def test_a_change_that_is_never_answered_nor_made_says_so() -> None:
    sim = FlakyMks(1, baudrate=38400)
    sim.lose_request(r.ADDRESS, times=3)
    result = await set_address(Adapter(sim), 17)
    assert not result.confirmed
    assert "did not acknowledge the change and still answers" in result.message
    assert (await set_address(Adapter(sim), 17)).confirmed


@on_virtual_clock
async def test_a_drive_that_is_gone_afterwards_is_said_to_be_gone() -> None:
    sim = FlakyMks(1, baudrate=38400)
    sim.instead(r.ADDRESS, sim.switch_off)
    result = await set_address(Adapter(sim), 17)
    assert not result.confirmed
    assert result.place is None
    assert "answers neither address 1 at 38400 bit/s nor address 17 at 38400 bit/s" in result.message


@on_virtual_clock
async def test_nobody_at_either_place_is_an_error() -> None:
    with pytest.raises(NoReply, match="neither address 1 at 38400 bit/s nor address 17"):
        await set_address(Adapter(SimMks(2, baudrate=38400)), 17)
    with pytest.raises(NoReply, match="Nobody answers: address 1"):
        await disable_modbus(Adapter(SimMks(2, baudrate=38400)))


@on_virtual_clock
async def test_a_second_drive_on_the_pair_is_noticed_before_both_have_one_address() -> None:
    sims = SimMks(1, baudrate=38400), SimMks(17, baudrate=38400)
    with pytest.raises(AddressInUse, match="Only one drive may be on the pair"):
        await set_address(Adapter(*sims), 17)
    assert [sim.address for sim in sims] == [1, 17]


@pytest.mark.parametrize("noise", [Noise(lost_reply=0.3), Noise(late=0.3, late_by=0.5)])
@on_virtual_clock
async def test_nor_do_two_get_one_address_where_replies_are_lost_or_late(noise: Noise) -> None:
    for seed in range(60):
        sims = SimMks(1, baudrate=38400, answers_at_new=seed % 2 > 0), SimMks(5, baudrate=38400)
        rates = itertools.count(100 * seed)
        with pytest.raises((AddressInUse, NoReply)):
            await set_address(
                lambda rate, sims=sims, rates=rates: VirtualLine(*sims, baudrate=rate, noise=noise, seed=next(rates)), 5
            )
        assert sims[0].address == 1


@on_virtual_clock
async def test_a_turning_motor_is_not_sent_elsewhere() -> None:
    sim = SimMks(1, baudrate=38400)
    sim.motion.run((MotionDirection.CCW, 0, 60), 0.0)
    for change in (
        set_address(Adapter(sim), 17),
        set_baud_rate(Adapter(sim), BaudRate.BAUD_9600),
        disable_modbus(Adapter(sim)),
    ):
        with pytest.raises(NotStanding):
            await change
    assert (sim.address, sim.baudrate) == (1, 38400)


@pytest.mark.parametrize("address", [0, 248, 255, -1])
@on_virtual_clock
async def test_addresses_that_are_none_are_not_sent(address: int) -> None:
    adapter = Adapter(SimMks(1, baudrate=38400))
    with pytest.raises(LimitExceeded, match=rf"address {address} is outside 1\.\.247"):
        await set_address(adapter, address)
    assert not adapter.rates


@on_virtual_clock
async def test_a_refusal_is_an_error() -> None:
    sim = SimMks(1, baudrate=38400)
    sim._commands[r.ADDRESS.address] = sim._commands[99] = _refuse
    with pytest.raises(DeviceRefused):
        await set_address(Adapter(sim), 17)


def _refuse(value: object, now: float) -> None:
    from rs485bus.sim.mks_memory import Refused

    raise Refused


# Modbus on and off


@pytest.mark.parametrize("at_new", [False, True])
@pytest.mark.parametrize("address", [1, 9])
@on_virtual_clock
async def test_modbus_is_switched_off_and_on_again(address: int, at_new: bool) -> None:
    sim = SimMks(address, baudrate=38400, answers_at_new=at_new)
    off = await disable_modbus(Adapter(sim), address=address)
    # An answer at the new setting is in the native protocol: it proves nothing here.
    assert off.confirmed is not at_new
    assert off.place is None
    assert sim.settings[r.MODBUS.address] is False
    on = await enable_modbus(Adapter(sim), address=address)
    assert on.confirmed
    assert on.place == Place(address, 38400)
    assert sim.settings[r.MODBUS.address] is True


@on_virtual_clock
async def test_modbus_that_is_on_already_is_left_alone() -> None:
    result = await enable_modbus(Adapter(SimMks(1, baudrate=38400)))
    assert result.confirmed
    assert "already" in result.message


@on_virtual_clock
async def test_a_drive_that_does_not_come_to_speak_modbus_is_not_confirmed() -> None:
    result = await enable_modbus(Adapter(SimMks(2, baudrate=38400)))
    assert not result.confirmed
    assert result.place is None
    assert "MB_RTU" in result.message


@on_virtual_clock
async def test_a_drive_that_goes_on_speaking_modbus_is_not_confirmed_to_be_off() -> None:
    sim = FlakyMks(1, baudrate=38400)
    sim.lose_request(r.MODBUS, times=3)
    result = await disable_modbus(Adapter(sim))
    assert not result.confirmed
    assert result.place == Place(1, 38400)


@on_virtual_clock
async def test_the_native_frame_goes_out_after_the_silence_and_its_answer_disturbs_nobody() -> None:
    sim = SimMks(1, baudrate=38400)
    sim.settings[r.MODBUS.address] = False
    adapter = Adapter(sim)
    frames: list[bytes] = []
    receive = sim.receive

    def hear(frame: bytes, now: float) -> bytes | None:
        frames.append(frame)
        return receive(frame, now)

    sim.receive = hear  # type: ignore[method-assign] # a tap on the wire
    await enable_modbus(adapter)
    assert bytes.fromhex("FA 01 8E 01 8A") in frames
    assert adapter.lines[0].pair.early_frames == adapter.lines[0].pair.collisions == 0

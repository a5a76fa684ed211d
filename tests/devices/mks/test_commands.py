"""Each of the 49 commands of the manual goes out by a typed call, and the drive does it."""

from typing import Any

from rs485bus.devices.mks import (
    CLOSE_GAINS,
    VFOC_GAINS,
    BaudRate,
    EnableLevel,
    HoldingCurrent,
    MksProfile,
    Model,
    ParameterDirection,
    PositionProtection,
    PulseDivider,
    SingleTurnHoming,
    SwitchHoming,
    WorkMode,
)
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.provisioning import disable_modbus, set_address, set_baud_rate
from rs485bus.sim import VirtualLine
from rs485bus.wire.registers import Block, Register
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock

EVERYTHING = MksProfile(
    mode=WorkMode.SR_VFOC,
    current=1000,
    holding_current=HoldingCurrent.PERCENT_50,
    microsteps=16,
    enable_level=EnableLevel.ALWAYS,
    pulse_direction=ParameterDirection.CW,
    screen_off=False,
    interpolation=True,
    key_lock=False,
    vfoc_gains=VFOC_GAINS,
    close_gains=CLOSE_GAINS,
    overcurrent_protection=False,
    position_protection=PositionProtection(turns=1.0, seconds=1.0, enabled=False),
    pulse_divider=PulseDivider(period=0),
    limit_remap=False,
    homing=SwitchHoming(rpm=600),
)


class Heard(FlakyMks):
    """A drive that keeps what it was told and has done, by register and number of registers."""

    def __init__(self) -> None:
        super().__init__(model=Model.SERVO57D, baudrate=38400)
        self.done: set[tuple[int, int]] = set()

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        reply = super().answer(pdu, now, broadcast=broadcast)
        refused = {6: b"\xff\xff", 16: b"\0\0"}.get(pdu[0])
        if reply is not None and reply[3:5] != refused:
            count = 1 if pdu[0] == 6 else int.from_bytes(pdu[3:5], "big")
            self.done.add((int.from_bytes(pdu[1:3], "big"), count))
        return reply


@on_virtual_clock
async def test_all_49_commands_of_the_manual_have_a_typed_call() -> None:
    sim = Heard()
    async with bench(sim, baudrate=38400, enable=False) as on:
        x = on.axis
        await x.write_profile(EVERYTHING)
        await x.enable()
        await x.home()
        await x.move_to(1.0)
        await x.return_to_zero()
        await x.move_by_pulses(3200)
        await x.move_to_pulses(0)
        await x.move_by_counts(16384)
        await x.run(60)
        await x.run(0)
        await x.run(60, duration=0.5)
        await x.set_zero()
        await x.emergency_stop()
        await x.set_homing(SingleTurnHoming())
        await x.set_heartbeat(0)
        await x.set_outputs(out_1=True)
        await x.set_power_on_run(False)
        await x.release_stall()
        for question in (x.encoder, x.position, x.velocity, x.pulses, x.angle_error, x.version, x.status):
            await question()
        await x.silence()
        await x.wake()
        for verb in (x.calibrate, x.restart, x.factory_reset):
            await verb()
    port = lambda baudrate: VirtualLine(sim, baudrate=baudrate)  # noqa: E731 - an adapter for any rate
    assert (await set_address(port, 5)).confirmed
    assert (await set_baud_rate(port, BaudRate.BAUD_115200, address=5)).confirmed
    assert (await disable_modbus(port, address=5, baudrate=115200)).confirmed
    commands: tuple[Register[Any] | Block, ...] = (*r.READS, *r.SINGLE_WRITES, *r.BLOCK_WRITES)
    assert len({command.address for command in commands}) == 49
    assert {(command.address, command.count) for command in commands} == sim.done

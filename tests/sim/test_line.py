"""The virtual pair keeps the rules of a real one."""

import itertools

import pytest

from rs485bus.sim import Noise, SimUnit
from rs485bus.sim.device import KEPT
from rs485bus.sim.line import VirtualPair
from rs485bus.sim.modbus import ModbusData, SimModbus
from rs485bus.wire.frames import read_holding, write_single
from rs485bus.wire.timing import LineSettings

LINE = LineSettings(baudrate=9600)
ASK = read_holding(1, 0, 1)


def pair(*devices: SimUnit, noise: Noise | None = None, seed: int = 0) -> VirtualPair:
    return VirtualPair(devices or (SimUnit(1, {0: 7}),), LINE, noise or Noise(), seed, turnaround=0.01)


def hear(pair: VirtualPair, until: float) -> list[tuple[float, bytes]]:
    heard = []
    while pair.next_at <= until:
        now = pair.next_at
        heard += [(now, piece) for piece in pair.advance(now)]
    return heard


def whole(heard: list[tuple[float, bytes]]) -> bytes:
    return b"".join(piece for _, piece in heard)


def test_a_reply_comes_after_the_turnaround_and_byte_by_byte() -> None:
    line = pair()
    line.transmit(ASK.adu, 0.0)
    heard = hear(line, 1.0)
    assert whole(heard) == bytes.fromhex("01 03 02 00 07 F9 86")
    begin = LINE.airtime(8) + 0.01
    assert heard[0][0] == pytest.approx(begin + LINE.airtime(1))
    assert heard[-1][0] == pytest.approx(begin + LINE.airtime(7))


def test_a_frame_that_starts_before_t35_of_silence_is_counted_and_not_understood() -> None:
    line = pair()
    line.transmit(ASK.adu, 0.0)
    end = hear(line, 1.0)[-1][0]
    line.transmit(ASK.adu, end + LINE.t35 * 0.9)
    assert hear(line, 2.0) == []
    assert line.early_frames == 1


def test_a_frame_after_it_is_understood() -> None:
    line = pair()
    line.transmit(ASK.adu, 0.0)
    end = hear(line, 1.0)[-1][0]
    line.transmit(ASK.adu, end + LINE.t35)
    assert whole(hear(line, 2.0))
    assert line.early_frames == 0


@pytest.mark.parametrize(("waited", "over_noise", "early"), [(0.010, 0, 2), (0.025, 2, 0)])
def test_what_has_waited_long_enough_goes_over_noise_and_so_does_what_repeats_it(
    waited: float, over_noise: int, early: int
) -> None:
    line = pair()
    line.babble(itertools.repeat(0.001, 200), 0.0)
    hear(line, waited)
    line.transmit(ASK.adu, waited)
    again = waited + LINE.airtime(8) + 0.004
    hear(line, again)
    line.transmit(ASK.adu, again)
    assert (line.frames_over_noise, line.early_frames) == (over_noise, early)


def test_a_gap_that_a_frame_has_fallen_into_does_not_end_the_noise_that_the_next_one_waited_for() -> None:
    line = pair()
    line.babble(iter([*24 * [0.001], 0.010, *20 * [0.001]]), 0.0)
    hear(line, 0.024 + LINE.t35)
    line.transmit(b"\x01\x03", 0.024 + LINE.t35)
    hear(line, 0.040)
    line.transmit(ASK.adu, 0.040)
    assert (line.frames_over_noise, line.early_frames) == (1, 0)


def test_all_that_is_said_over_noise_after_a_gap_in_it_has_waited_for_the_same_noise() -> None:
    """A frame went out in the gap. Three stops waited, and the noise goes on before there is another silence."""
    fast = LineSettings(baudrate=115200)
    line = VirtualPair((SimUnit(1, {0: 7}),), fast, Noise(), 0)
    begin = 0.024 + fast.t35
    line.babble(iter([*24 * [0.001], begin + fast.airtime(8) + 0.0008 - 0.024, *40 * [0.001]]), 0.0)
    for at in (begin, begin + 0.004, begin + 0.008, begin + 0.012):
        hear(line, at)
        line.transmit(ASK.adu, at)
    assert (line.frames_over_noise, line.early_frames) == (3, 0)


def test_what_follows_an_answer_at_once_is_early_however_noisy_the_pair_was_before() -> None:
    line = pair()
    line.babble(itertools.repeat(0.001, 30), 0.0)
    hear(line, 0.030)
    line.transmit(ASK.adu, 0.030 + LINE.t35)
    end = hear(line, 1.0)[-1][0]
    line.transmit(ASK.adu, end + LINE.t35 / 2)
    assert (line.frames_over_noise, line.early_frames) == (0, 1)


def test_a_frame_may_be_written_in_pieces_if_they_follow_each_other() -> None:
    line = pair()
    line.transmit(ASK.adu[:3], 0.0)
    line.transmit(ASK.adu[3:], LINE.airtime(3) + LINE.t15 * 0.9)
    assert whole(hear(line, 1.0))


def test_two_that_talk_at_once_destroy_each_others_bytes() -> None:
    line = pair()
    line.transmit(ASK.adu, 0.0)
    hear(line, LINE.airtime(8) + 0.01 + LINE.airtime(2))
    line.transmit(ASK.adu, LINE.airtime(8) + 0.01 + LINE.airtime(2))
    assert whole(hear(line, 1.0))[:7] != bytes.fromhex("01 03 02 00 07 F9 86")
    assert line.collisions == 1


def test_a_broadcast_is_done_by_all_and_answered_by_none() -> None:
    units = [SimUnit(1, {0: 7}), SimUnit(2, {0: 7})]
    line = pair(*units)
    line.transmit(write_single(0, 0, 9).adu, 0.0)
    assert hear(line, 1.0) == []
    assert [unit.registers[0] for unit in units] == [9, 9]


def test_a_device_set_to_another_baud_rate_hears_nothing() -> None:
    unit = SimUnit(1, {0: 7})
    unit.baudrate = 19200
    line = pair(unit)
    line.transmit(ASK.adu, 0.0)
    assert hear(line, 1.0) == []


def test_noise_is_the_same_for_the_same_seed() -> None:
    def run(seed: int) -> bytes:
        line = pair(noise=Noise(flipped=0.5, lost_reply=0.2, torn=0.2, stray=0.3), seed=seed)
        for at in range(50):
            line.transmit(ASK.adu, at * 1.0)
            yielded.append(whole(hear(line, at + 0.9)))
        return b"|".join(yielded)

    yielded: list[bytes] = []
    first = run(1)
    yielded.clear()
    assert run(1) == first
    yielded.clear()
    assert run(2) != first


@pytest.mark.parametrize(
    ("noise", "received"),
    [
        (Noise(lost_request=1.0), b""),
        (Noise(lost_reply=1.0), b""),
        (Noise(duplicated=1.0), 2 * bytes.fromhex("01 03 02 00 07 F9 86")),
        (Noise(echo=True), ASK.adu + bytes.fromhex("01 03 02 00 07 F9 86")),
    ],
)
def test_each_fault_does_what_it_says(noise: Noise, received: bytes) -> None:
    line = pair(noise=noise)
    line.transmit(ASK.adu, 0.0)
    assert whole(hear(line, 1.0)) == received


def test_a_probability_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"torn 1\.5 is outside 0\.\.1"):
        Noise(torn=1.5)
    with pytest.raises(ValueError, match="late_by -1"):
        Noise(late_by=-1)


@pytest.mark.parametrize("device", [SimUnit(1, {3: 0}), SimModbus(1, ModbusData(registers={3: 0}))])
def test_a_device_that_runs_for_days_remembers_its_latest_requests_only(device: SimUnit | SimModbus) -> None:
    for value in range(3 * KEPT):
        device.receive(write_single(1, 3, value).adu, 0.001 * value)
    history = device.writes if isinstance(device, SimUnit) else device.asked
    assert KEPT <= len(history) <= 2 * KEPT
    assert history[-1] in ((0.001 * value, 3, (value,)), write_single(1, 3, value).adu[1:-2])

"""For how long a stop has waited for silence, by plain calls: noise that is over, and answers, do not count."""

from __future__ import annotations

from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.schedule.job import stop_job
from rs485bus.bus.units.reply_times import ReplyTimes
from rs485bus.wire.frames import write_single
from rs485bus.wire.timing import LineSettings

LINE = LineSettings(baudrate=9600)
STOP = write_single(1, 5, 7)


class Pair:
    """A pair on which there was noise half a second ago."""

    def __init__(self) -> None:
        self.line = SerialLine(LINE, LINE.t35, False, 0.0)
        self.line.noise_at = self.now = 1.0
        self.now += 0.5

    def stops(self) -> None:
        """Send one as soon as there is silence."""
        self.now = max(self.now, self.line.quiet_at)
        self.line.begin(stop_job(STOP), self.now, 0.1, (), ReplyTimes())

    def ends(self, after: float) -> None:
        """It was not answered in so many seconds."""
        self.now = self.line.air_end + after
        self.line.end((), self.now, answered=False)

    def hears(self, data: bytes, begin: float) -> None:
        """Bytes are heard, the first one of which begins then."""
        received = []
        for at in range(len(data)):
            self.now = begin + LINE.airtime(at + 1)
            received += self.line.feed(data[at : at + 1], self.now)
        if received:
            self.line.end((), self.now, answered=True)

    @property
    def waited(self) -> float:
        """Seconds for which the next one has waited for silence."""
        return self.now - self.line.noisy_since


def test_silence_behind_an_answer_is_no_gap_in_noise() -> None:
    pair = Pair()
    pair.stops()
    pair.hears(STOP.adu, pair.line.air_end + 0.004)
    pair.stops()
    pair.hears(bytes(9), pair.line.air_end + 0.001)  # a late answer of somebody else, destroyed
    assert pair.waited < 0.01


def test_an_answer_is_no_noise_that_a_stop_has_waited_for() -> None:
    pair = Pair()
    pair.stops()
    pair.hears(STOP.adu, pair.line.air_end + 0.004)
    pair.hears(bytes(6), pair.now)
    assert pair.waited < 0.007


def test_silence_behind_a_stop_that_nobody_answers_is_no_gap_in_noise() -> None:
    pair = Pair()
    pair.stops()
    pair.hears(STOP.adu, pair.line.air_end + 0.004)
    pair.stops()
    pair.ends(after=0.01)
    pair.stops()
    pair.hears(bytes(9), pair.line.air_end + 0.001)
    assert pair.waited < 0.01


def test_what_is_heard_while_a_stop_goes_out_is_waited_for_from_its_end() -> None:
    pair = Pair()
    pair.stops()
    pair.hears(bytes(16), pair.line.air_end - 0.007)
    assert pair.waited < 0.01


def test_a_gap_that_a_stop_has_used_does_not_end_the_noise_that_the_next_one_waits_for() -> None:
    pair = Pair()
    pair.hears(bytes(9), pair.now)
    begun = pair.line.noisy_since
    pair.stops()
    pair.hears(bytes(9), pair.line.air_end + 0.001)
    assert pair.line.noisy_since == begun

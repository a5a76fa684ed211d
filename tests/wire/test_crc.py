"""The CRC, beside pymodbus' own, of frames and of parts of a stream."""

from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU

from rs485bus.wire.crc import StreamCrc, crc, ends_in_crc


@given(st.binary(max_size=254))
def test_a_crc_is_what_pymodbus_makes_of_it_and_closes_the_frame(body: bytes) -> None:
    assert crc(body) == FramerRTU.compute_CRC(body).to_bytes(2, "big")
    assert ends_in_crc(body + crc(body))


@given(
    st.lists(st.one_of(st.binary(max_size=20), st.binary(max_size=20).map(lambda body: body + crc(body)))), st.data()
)
def test_any_part_of_a_stream_that_grows_and_is_dropped_closes_exactly_if_it_does_alone(
    arriving: list[bytes], data: st.DataObject
) -> None:
    stream, running = bytearray(), StreamCrc()
    for piece in arriving:
        stream += piece
        running.extend(stream)
        for begin in range(len(stream)):
            for end in range(begin + 1, len(stream) + 1):
                assert running.closes(begin, end) is ends_in_crc(bytes(stream[begin:end]))
        dropped = data.draw(st.integers(0, len(stream)))
        del stream[:dropped]
        running.drop(dropped)

"""What a port's name means, and what is said where it means nothing."""

import sys
from pathlib import Path

import pytest

from rs485bus import BusConfig, open_bus
from rs485bus.errors import NotSupported
from rs485bus.transport.interface import Transport
from rs485bus.transport.modbus_tcp import ModbusTcpTransport
from rs485bus.transport.rtu_over_tcp import TcpTransport
from rs485bus.transport.serial import SerialTransport


def transport(port: str, **options: object) -> Transport:
    return open_bus(port, **options)._make()  # type: ignore[arg-type]


def test_each_scheme_has_its_transport() -> None:
    rtu = transport("socket://192.168.1.10:4196")
    assert isinstance(rtu, TcpTransport)
    assert rtu.line.baudrate == 9600
    mbap = transport("tcp://192.168.1.10", baudrate=19200)
    assert isinstance(mbap, ModbusTcpTransport)
    assert mbap.name == "tcp://192.168.1.10:502"
    assert mbap.line.baudrate == 19200
    assert transport("tcp://[::1]:1502", native=True).name == "tcp://::1:1502"
    assert isinstance(transport("/dev/ttyUSB0", baudrate=9600), SerialTransport)
    assert isinstance(transport("COM3", baudrate=9600, backend="pyserial"), SerialTransport)


@pytest.mark.parametrize(
    ("port", "host"),
    [("192.168.1.10", ""), ("192.168.1.10:4001", ":4001"), ("gateway.local", ""), ("moxa:502", ":502")],
)
@pytest.mark.parametrize("options", [{}, {"baudrate": 9600}])
def test_a_bare_host_says_which_schemes_there_are(port: str, host: str, options: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="does not say how it speaks") as caught:
        open_bus(port, **options)
    for scheme, usual in (("socket", ":4196"), ("tcp", ":502"), ("rfc2217", ":4196")):
        assert f"{scheme}://{port.partition(':')[0]}{host or usual}" in str(caught.value)
    assert "'/dev/ttyUSB0'" in str(caught.value)


def test_a_path_without_a_slash_is_a_port_if_it_looks_like_one_or_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "axes").touch()
    for port in ("axes", "ttyUSB0", "COM3", "cu.usbserial-1"):
        assert isinstance(transport(port, baudrate=9600), SerialTransport)


@pytest.mark.parametrize(
    ("port", "options", "said"),
    [
        ("tcp://", {}, "should look like tcp://192.168.1.10:502"),
        ("tcp://host:99999", {}, "should look like tcp://192.168.1.10:502"),
        ("socket://host", {}, "should look like socket://192.168.1.10:4196"),
        ("socket://host:4196/x", {}, "should look like socket://192.168.1.10:4196"),
        ("socket://host:1", {"native": True}, "native=True is for a device that speaks Modbus TCP itself"),
        ("/dev/ttyUSB0", {"native": True, "baudrate": 9600}, "native=True is for"),
        ("tcp://host", {"backend": "serialx"}, "backend is for serial ports"),
        ("/dev/ttyUSB0", {"backend": "pyusb", "baudrate": 9600}, "neither 'pyserial' nor 'serialx'"),
        ("rfc2217://host:2217", {}, "Say the baud rate"),
        ("socket://host:1", {"config": BusConfig(silence=0.001)}, "a gateway keeps its own"),
        ("tcp://host", {"config": BusConfig(silence=0.001)}, "a gateway keeps its own"),
        ("/dev/ttyUSB0", {"baudrate": 9600, "config": BusConfig(silence=0.001)}, "less than 1.5 characters at 9600"),
    ],
)
def test_what_does_not_fit_is_refused_with_what_does(port: str, options: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        open_bus(port, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("url", ["rfc2217://host:2217", "esphome://host:6053/?port_name=a"])
def test_without_serialx_its_urls_say_what_to_install(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serialx", None)
    with pytest.raises(NotSupported, match=r'pip install "rs485bus\[serialx\]"'):
        open_bus(url, baudrate=9600)
    with pytest.raises(NotSupported, match=r'pip install "rs485bus\[serialx\]"'):
        open_bus("/dev/ttyUSB0", baudrate=9600, backend="serialx")
    with pytest.raises(ValueError, match="'gopher://host' is no port"):
        open_bus("gopher://host", baudrate=9600)


def test_the_urls_of_serialx_have_their_transports_and_keep_their_secrets() -> None:
    pytest.importorskip("serialx")
    network = transport("rfc2217://user@host:2217?password=secret&x=1", baudrate=9600)
    assert network.name == "rfc2217://user@host:2217?password=...&x=1"
    assert network.gateway
    assert isinstance(transport("device:///dev/ttyUSB0", baudrate=9600), SerialTransport)
    with pytest.raises(ValueError, match="'gopher://host' is no port"):
        open_bus("gopher://host", baudrate=9600)
    with pytest.raises(ValueError, match="rs485_direction is for ports of this machine"):
        open_bus("rfc2217://host:2217", baudrate=9600, config=BusConfig(rs485_direction=True))

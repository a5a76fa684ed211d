"""pyserial's RFC 2217 server on a pseudo-terminal: `python rfc2217_server.py <path> <TCP port>`."""

import contextlib
import socket
import sys
import threading

import serial
import serial.rfc2217


class Port(serial.Serial):
    """A pseudo-terminal, which has no modem lines."""

    cts = dsr = ri = cd = False  # type: ignore[assignment]


class Client:
    """Where the server writes to."""

    def __init__(self, connection: socket.socket) -> None:
        self.write = connection.sendall


def main() -> None:
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2304)  # as small as can be
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind(("127.0.0.1", int(sys.argv[2])))
    listener.listen()
    print("ready", flush=True)
    while True:
        connection, _ = listener.accept()
        port = Port(sys.argv[1], baudrate=9600, timeout=0.01)
        manager = serial.rfc2217.PortManager(port, Client(connection))

        def to_client(port: Port = port, connection: socket.socket = connection, manager: object = manager) -> None:
            while port.is_open:
                try:
                    data = port.read(256)
                    if data:
                        connection.sendall(b"".join(manager.escape(data)))  # type: ignore[attr-defined]
                except (OSError, TypeError, serial.SerialException):
                    return

        threading.Thread(target=to_client, daemon=True).start()
        with contextlib.suppress(ConnectionError):
            while data := connection.recv(256):
                port.write(b"".join(manager.filter(data)))
        port.close()
        connection.close()


main()

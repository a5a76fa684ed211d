"""The way to an MQTT 5 broker, and what its refusals mean."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote, urlsplit

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from rs485bus.bus.handle import running_loop
from rs485bus.errors import BrokerError
from rs485bus.service.decisions import Asker

_quiet = logging.getLogger("rs485bus.mqtt")
_quiet.setLevel(logging.CRITICAL)  # what happens to the connection is raised, and told by who uses it

DEFAULT = "mqtt://127.0.0.1"
_PORTS = {"mqtt": 1883, "mqtts": 8883}
_PATIENCE = 5.0
"""Seconds to wait for the broker."""
_FAREWELL = 0.5
"""Seconds to wait for it to close the connection."""
KEEPALIVE = 5
"""Seconds of silence after which the broker and its client look whether the other is still there."""

LARGEST = 2**21
"""Bytes of the largest message that is taken in, to be refused perhaps."""

NO_RETAINED = SubscribeOptions(qos=1, retainAsPublished=True, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND)
"""Nothing that was retained before comes, and what is retained now says so."""
WITH_RETAINED = SubscribeOptions(qos=1)


class Client(aiomqtt.Client):
    """A connection to the broker. In contrast to aiomqtt's, it tells what the broker refuses to take."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.pending_calls_threshold = 100_000
        self._taken: dict[int, asyncio.Future[ReasonCode]] = {}

    def send(
        self, topic: str, payload: bytes, *, qos: int = 1, retain: bool = False, properties: Properties | None = None
    ) -> asyncio.Future[ReasonCode]:
        """Publish a message. What is returned tells, for `qos` 1, how the broker took it; of a connection that is lost
        it tells nothing."""
        taken: asyncio.Future[ReasonCode] = self._loop.create_future()
        info = self._client.publish(topic, payload, qos, retain, properties)
        if info.rc == 0 and qos:
            self._taken[info.mid] = taken
        return taken

    async def deliver(
        self, topic: str, payload: bytes, *, retain: bool = False, properties: Properties | None = None
    ) -> None:
        """Publish a message and wait until the broker has taken it.

        Raises:
            BrokerError: it refuses to, because its access control forbids it, say.
            aiomqtt.MqttError: the connection is lost.
        """
        taken = self.send(topic, payload, retain=retain, properties=properties)
        await asyncio.wait((taken, self._disconnected), return_when=asyncio.FIRST_COMPLETED)
        if not taken.done():
            raise aiomqtt.MqttError("the connection is lost")
        if taken.result().is_failure:
            raise BrokerError(self.refusal(topic, taken.result()))

    async def next_message(self, seconds: float) -> aiomqtt.Message | None:
        """The next message; None if there is none within so many seconds. In contrast to `messages`, that may be over
        in the moment in which a message comes in: it is not lost."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                return await self._queue.get()
        return None

    def refusal(self, topic: str, code: ReasonCode) -> str:
        """What it means that the broker does not take a message."""
        return (
            f"The broker does not take {topic} from {self.identifier}: {code}. Its access control list must allow it; "
            "the guide has an example."
        )

    @property
    def lost(self) -> BaseException | None:
        """Why the connection was lost; None while it was not. (Looked at: else asyncio calls it forgotten.)"""
        over = self._disconnected
        return over.exception() if over.done() and not over.cancelled() else None

    def abandon(self) -> None:
        """Close the socket of a connection that has come to nothing. aiomqtt leaves it open."""
        self._client._sock_close()

    def _on_socket_register_write(self, client: PahoClient, userdata: Any, sock: Any) -> None:
        """Write as soon as the socket takes it. aiomqtt looks at the socket one turn of the loop later: by then it may
        be closed, and its number that of another file, of a serial port perhaps."""
        if running_loop() is not self._loop:
            super()._on_socket_register_write(client, userdata, sock)
            return

        def write() -> None:
            try:
                client.loop_write()
            except Exception as error:
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        self._loop.add_writer(sock.fileno(), write)

    def _on_publish(
        self, client: PahoClient, userdata: Any, mid: int, reason_code: ReasonCode, properties: Properties
    ) -> None:
        taken = self._taken.pop(mid, None)
        if taken is not None and not taken.done():
            taken.set_result(reason_code)
        super()._on_publish(client, userdata, mid, reason_code, properties)


@dataclass(frozen=True, slots=True, kw_only=True)
class Broker:
    """Where a broker is, and as whom it is used.

    Raises:
        ValueError: certificate and key do not come together, or TLS files are given for a connection without TLS.
    """

    host: str
    port: int
    tls: bool = False
    username: str | None = None
    password: str | None = None
    ca: str | None = None
    """The file with the certificate of who signs for the broker; None for those that the system trusts."""
    certificate: str | None = None
    key: str | None = None

    def __post_init__(self) -> None:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("a client's certificate and its key go together: give both or none")
        if not self.tls and (self.ca or self.certificate):
            raise ValueError(f"certificates need TLS: mqtts://{self.host}")

    @classmethod
    def at(
        cls,
        url: str = DEFAULT,
        *,
        username: str | None = None,
        password: str | None = None,
        ca: str | None = None,
        certificate: str | None = None,
        key: str | None = None,
    ) -> Broker:
        """A broker by its address: mqtt://host, mqtts://user:password@host:8883.

        Raises:
            ValueError: that is no address of a broker.
        """
        parts = urlsplit(url)
        try:
            port = parts.port or _PORTS[parts.scheme]
        except (KeyError, ValueError):
            raise ValueError(f"broker {url!r} is not mqtt://host, mqtt://host:port or mqtts://host (TLS)") from None
        if not parts.hostname or parts.path.strip("/") or parts.query:
            raise ValueError(f"broker {url!r} is not mqtt://host, mqtt://host:port or mqtts://host (TLS)")
        return cls(
            host=parts.hostname,
            port=port,
            tls=parts.scheme == "mqtts",
            username=username if username is not None else _text(parts.username),
            password=password if password is not None else _text(parts.password),
            ca=ca,
            certificate=certificate,
            key=key,
        )

    def __str__(self) -> str:
        return f"{'mqtts' if self.tls else 'mqtt'}://{self.host}:{self.port}"

    @asynccontextmanager
    async def connect(self, identifier: str, will: aiomqtt.Will | None = None) -> AsyncIterator[Client]:
        """A connection for the length of a block. It starts anew each time: the broker keeps nothing for it.

        Raises:
            BrokerError: it cannot be had, or is lost within the block; the message says what to do.
        """
        options: dict[str, Any] = {}
        if self.tls:
            options["tls_context"] = self._tls_context()
        client = Client(
            self.host,
            self.port,
            identifier=identifier,
            protocol=aiomqtt.ProtocolVersion.V5,
            username=self.username,
            password=self.password,
            will=will,
            keepalive=KEEPALIVE,
            clean_start=True,
            properties=_limited(),
            socket_options=((socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),),
            timeout=_PATIENCE,
            logger=_quiet,
            **options,
        )
        try:
            await client.__aenter__()
        except aiomqtt.MqttError as error:
            client.abandon()
            raise BrokerError(self._why(error)) from None
        try:
            yield client
        except aiomqtt.MqttError as error:
            raise BrokerError(f"The connection to the broker {self} was lost: {client.lost or error}.") from None
        finally:
            client.timeout = _FAREWELL
            with contextlib.suppress(aiomqtt.MqttError):  # it is lost
                await client.__aexit__(None, None, None)
            _ = client.lost

    def _tls_context(self) -> ssl.SSLContext:
        try:
            context = ssl.create_default_context(cafile=self.ca)
            if self.certificate is not None:
                context.load_cert_chain(self.certificate, self.key)
        except OSError as error:
            raise BrokerError(f"A certificate for {self} cannot be used: {error}.") from None
        return context

    def _why(self, error: aiomqtt.MqttError) -> str:
        """Why there is no connection, and what to do."""
        said = str(error)
        code = error.rc if isinstance(error, aiomqtt.MqttCodeError) else None
        if isinstance(code, ReasonCode):
            return f"The broker {self} refuses the connection: {code}. {_REMEDIES.get(code.getName(), '')}".strip()
        if "refused" in said.lower():
            return (
                f"Nobody listens at {self}. Start the broker there (systemctl start mosquitto), and have it listen to "
                "other computers, too, where this is one."
            )
        if "CERTIFICATE_VERIFY_FAILED" in said:
            return f"The certificate of {self} is not trusted: {said}. Name who signed it: ca='ca.crt' (--ca)."
        if "SSL" in said or "EOF" in said:
            return f"{self} does not speak TLS: {said}. Without TLS it is mqtt://, usually at port 1883."
        if "timed out" in said.lower():
            return f"{self} does not answer within {_PATIENCE:g} s. If it expects TLS, it is mqtts://."
        return f"There is no connection to {self}: {said}."


_REMEDIES = {
    "Bad user name or password": "Look at user and password: mqtt://user@host, and the password from a file.",
    "Not authorized": "Look at user and password; the broker may want one, or keep this one out.",
    "Unsupported protocol version": "It needs to speak MQTT 5, as mosquitto does from 1.6 on.",
    "Client identifier not valid": "Choose another name for the client.",
}


def _text(part: str | None) -> str | None:
    return None if part is None else unquote(part)


def asker_of(message: aiomqtt.Message) -> Asker | None:
    """Who wants an answer to a message."""
    topic = getattr(message.properties, "ResponseTopic", None)
    return Asker(topic, getattr(message.properties, "CorrelationData", b"")) if topic else None


def payload_of(message: aiomqtt.Message) -> bytes:
    """What a message says."""
    return message.payload if isinstance(message.payload, bytes) else str(message.payload).encode()


def answering(asker: Asker) -> Properties:
    """What goes with an answer."""
    properties = _properties()
    if asker.correlation:
        properties.CorrelationData = asker.correlation
    return properties


def asking(asker: Asker, expiry: float) -> Properties:
    """What goes with a request: where it is answered, and for how many seconds the broker keeps it."""
    properties = _properties()
    properties.ResponseTopic = asker.topic
    properties.CorrelationData = asker.correlation
    properties.MessageExpiryInterval = max(1, round(expiry))
    return properties


def last_will(topic: str, payload: bytes, *, retain: bool = False) -> aiomqtt.Will:
    """What the broker publishes when the connection breaks."""
    return aiomqtt.Will(topic, payload, qos=1, retain=retain)


def _limited() -> Properties:
    """What goes with a connection: the broker hands nothing on that is larger. To take in what is, the event loop, in
    which motors are looked after, would stand still."""
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call] # paho has no types here
    properties.MaximumPacketSize = LARGEST
    return properties


def _properties() -> Properties:
    return Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call] # paho has no types here

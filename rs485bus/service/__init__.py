"""A plant served over an MQTT 5 broker, for other programs and other hosts."""

from __future__ import annotations

try:
    import aiomqtt
    import pydantic
except ModuleNotFoundError as missing:
    raise ModuleNotFoundError(
        f"A plant that is served over a broker needs the package {missing.name}, which is not installed. Install it "
        'with: pip install "rs485bus[service]"',
        name=missing.name,
    ) from None

del aiomqtt, pydantic

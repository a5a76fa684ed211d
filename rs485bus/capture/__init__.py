"""Captures: what happened on a pair, kept in a file, told in words, drawn, and handed to Wireshark.

`bus.record_to(path)`, `rs485bus record` and `rs485bus sniff` write them; the format stands in
`rs485bus.bus.capture_lines`.

    from rs485bus.capture import load, summarise, words_of
    from rs485bus.capture.figures import timeline      # needs the extra `plot`

    capture = load("cell.jsonl")
    for exchange in capture.exchanges:
        print(words_of(exchange, capture.families.get(exchange.address)).asked)
    timeline(capture).savefig("cell.svg")
"""

from rs485bus.bus.capture_lines import Exchange, Header, Stray
from rs485bus.bus.recording import Recording
from rs485bus.capture.explanation import Words, values_of, words_of
from rs485bus.capture.pcap import write_pcap
from rs485bus.capture.reading import Capture, capture_of, load, name_drives
from rs485bus.capture.statistics import Summary, UnitSummary, summarise

__all__ = [
    "Capture",
    "Exchange",
    "Header",
    "Recording",
    "Stray",
    "Summary",
    "UnitSummary",
    "Words",
    "capture_of",
    "load",
    "name_drives",
    "summarise",
    "values_of",
    "words_of",
    "write_pcap",
]

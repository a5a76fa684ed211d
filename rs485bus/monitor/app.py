"""The view: axes above, the pairs and their latest transactions below."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
from collections import deque
from collections.abc import Sequence
from typing import ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import DataTable, Footer, Static

from rs485bus.bus.capture_lines import Exchange
from rs485bus.capture.explanation import words_of
from rs485bus.monitor.snapshot import AxisSight, BusSight, Snapshot
from rs485bus.monitor.thread import BusThread

_EVERY = 0.2
_INTERRUPTED = 130
_WIDE = 110
"""Columns from which on the bytes stand beside their meaning."""
_PORT = 16
"""Characters of a port's name that are shown, its last."""
_COLUMNS = ((" axis", 13), ("state", 8), ("position", 15), ("target", 9), ("rpm", 7), ("set", 6), ("watchdog", 11))
_STYLES = {"moving": "bold green", "stands": "", "released": "dim", "unknown": "yellow"}


class _Notices(logging.Handler):
    """Keeps what the log says: on the screen it would be in the way."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: deque[str] = deque(maxlen=20)

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


class MonitorApp(App[None]):
    """Shows what a thread of buses sees.

    Args:
        buses: the thread.
        title: what the plant is called.
    """

    CSS = """
    #buses { height: auto; background: $panel; padding: 0 1; }
    #axes { height: auto; max-height: 50%; }
    #frames { height: 1fr; padding: 0 1; }
    #notice { height: auto; max-height: 2; background: $panel; padding: 0 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "stop", "Stop axis"),
        Binding("space", "stop_all", "Stop all", priority=True),
        Binding("e", "emergency_stop", "Emergency stop"),
        Binding("p", "pause", "Pause view"),
        Binding("q", "quit", "Quit"),
        Binding("ctrl+c", "quit", show=False, priority=True),
    ]
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, buses: BusThread, title: str) -> None:
        super().__init__()
        self._buses = buses
        self._title = title
        self._paused = False
        self._notices = _Notices()
        self._rows: list[str] = []

    def compose(self) -> ComposeResult:
        yield Static(id="buses")
        yield DataTable(id="axes", cursor_type="row", zebra_stripes=True, cell_padding=0)
        yield Static(id="frames")
        yield Static(id="notice")
        yield Footer()

    def on_mount(self) -> None:
        table = self.query_one(DataTable)
        for name, width in _COLUMNS:
            table.add_column(name, key=name, width=width)
        logging.getLogger("rs485bus").addHandler(self._notices)
        loop = asyncio.get_running_loop()
        for number in (getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)):
            with contextlib.suppress(NotImplementedError):  # Windows
                loop.add_signal_handler(number, self.exit, None, _INTERRUPTED)
        self.set_interval(_EVERY, self._refresh)
        self._refresh()

    def on_unmount(self) -> None:
        logging.getLogger("rs485bus").removeHandler(self._notices)

    # Keys

    def action_stop(self) -> None:
        """Stop the axis under the cursor."""
        row = self.query_one(DataTable).cursor_row
        if 0 <= row < len(self._rows):
            name = self._rows[row]
            self._buses.tell(lambda watcher: watcher.stop(name))

    def action_stop_all(self) -> None:
        """Stop all axes by their ramps."""
        self._buses.tell(lambda watcher: watcher.stop_all())

    def action_emergency_stop(self) -> None:
        """Stop all drives as fast as they can."""
        self._buses.tell(lambda watcher: watcher.emergency_stop())

    def action_pause(self) -> None:
        """Hold the view as it is; the buses go on."""
        self._paused = not self._paused
        self._refresh()

    # What is shown

    def _refresh(self) -> None:
        if self._buses.ended:
            self.exit()
            return
        if self._paused:
            self.query_one("#notice", Static).update(Text("PAUSED: p goes on. The buses go on meanwhile.", "reverse"))
            return
        seen = self._buses.snapshot()
        if seen is None:
            return
        width = self.size.width
        self.query_one("#buses", Static).update(
            Text("\n").join(_bus_line(self._title, bus, width - 2) for bus in seen.buses)
        )
        self._show_axes(seen)
        frames = self.query_one("#frames", Static)
        frames.update(_frames(seen.buses, seen.at, width, frames.size.height))
        self.query_one("#notice", Static).update(_notice(seen, self._notices.said))

    def _show_axes(self, seen: Snapshot) -> None:
        table = self.query_one(DataTable)
        names = [axis.name for axis in seen.axes]
        if names != self._rows:
            table.clear()
            for axis in seen.axes:
                table.add_row(*_cells(axis), key=axis.name)
            self._rows = names
            return
        for axis in seen.axes:
            for (column, _), cell in zip(_COLUMNS, _cells(axis), strict=True):
                table.update_cell(axis.name, column, cell)


def _cells(axis: AxisSight) -> list[Text]:
    style = _STYLES.get(axis.state, "bold red")
    position = "-" if axis.position is None else f"{axis.position:.3f}"
    return [
        Text(f" {axis.name}", "bold"),
        Text(axis.state, style),
        Text(f"{position} {axis.unit[:5]}", justify="right"),
        Text("" if axis.target is None else f"{axis.target:.3f}", justify="right"),
        Text("-" if axis.rpm is None else f"{axis.rpm:.1f}", justify="right"),
        Text("" if axis.set_point is None else f"{axis.set_point:g}", justify="right"),
        _watchdog(axis),
    ]


def _notice(seen: Snapshot, logged: Sequence[str]) -> Text:
    """What is wrong with axes, what was done to them, and what the log said last."""
    text = Text()
    alike: dict[str, list[AxisSight]] = {}
    for axis in seen.axes:
        if axis.notice:
            alike.setdefault(axis.notice, []).append(axis)
    for notice, axes in alike.items():
        wrong = "NOT" in notice or any(axis.state in ("FAULT", "SILENT") for axis in axes)
        text.append(f"{', '.join(axis.name for axis in axes)}: {notice}  ", "bold red" if wrong else "bold")
    return text.append(logged[-1] if logged else "", "yellow")


def _watchdog(axis: AxisSight) -> Text:
    """How much of the watchdog's time is left."""
    if axis.margin is None or not axis.watchdog:
        return Text(" off", "dim")
    left = min(1.0, max(0.0, axis.margin / axis.watchdog))
    style = "green" if left > 0.5 else "yellow" if left > 0.25 else "bold red"
    return Text(f" {'#' * round(4 * left):4} {max(0.0, axis.margin):.2f}s", style)


def _bus_line(title: str, bus: BusSight, width: int) -> Text:
    port = bus.port if len(bus.port) <= _PORT else f"…{bus.port[1 - _PORT :]}"
    latency = "-" if bus.latency is None else f"{1000 * bus.latency:.1f} ms"
    text = Text(f"{title[:12]} {port} {bus.baudrate}  ", "bold", no_wrap=True)
    if not bus.connected:
        return text.append("NOT CONNECTED", "bold red")
    text.append(f"load {bus.load:.0%}  {bus.rate}/s  {latency}  ", "not bold")
    wrong = f"lost {bus.unanswered} ({bus.lost:.1%})" + (f" refused {bus.refused}" if bus.refused else "")
    text.append(wrong, "red" if bus.unanswered or bus.refused else "dim not bold")
    text.truncate(width, overflow="ellipsis")
    return text


def _frames(buses: tuple[BusSight, ...], now: float, width: int, height: int) -> Text:
    """The latest transactions, the newest at the bottom."""
    latest = sorted(((exchange, bus) for bus in buses for exchange in bus.latest), key=lambda pair: pair[0].ended)
    rows = 1 if width >= _WIDE else 2
    shown = latest[-max(1, height // rows) :] if height else []
    lines = []
    for exchange, bus in shown:
        lines += _exchange(exchange, bus, now, width)
    return Text("\n").join(lines)


def _exchange(exchange: Exchange, bus: BusSight, now: float, width: int) -> list[Text]:
    family = bus.families.get(exchange.address, "")
    words = words_of(exchange, family)
    style = "bold red" if words.error else {"stop": "magenta", "feed": "green"}.get(words.purpose, "")
    # What went wrong comes first: the end of the line may be cut off.
    said = f"{words.answered}: {words.asked}" if words.error else f"{words.asked} -> {words.answered}"
    meaning = f"{exchange.at - now:6.2f} {exchange.address or 'all':>3} {family:4} {words.purpose:7} {said}"
    frames = f"{exchange.request.hex(' ').upper()} > {exchange.reply.hex(' ').upper() or '-'}"
    if width < _WIDE:
        return [_cut(meaning, style, width - 2), _cut(" " * 11 + frames, "dim", width - 2)]
    room = width - 2
    left = room * 3 // 5
    line = _cut(meaning, style, left - 1)
    line.append(" " * (left - line.cell_len))
    return [line.append(_cut(frames, "dim", room - left))]


def _cut(text: str, style: str, width: int) -> Text:
    cut = Text(text, style, no_wrap=True)
    cut.truncate(width, overflow="ellipsis")
    return cut

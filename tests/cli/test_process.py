"""How a command ends: by signals, and when nobody reads its output. As real processes, in real time."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from rs485bus.cli import process
from rs485bus.errors import MotionError
from rs485bus.sim import Machine, SimMks, VirtualLine
from tests.real.support import in_real_time, posix

pytestmark = posix

COMMAND = (sys.executable, "-m", "rs485bus")
PIPE = asyncio.subprocess.PIPE


def as_in_the_background() -> None:
    """What a shell without job control does to what it starts with &."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def nohup() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)


class Plant:
    """Two drives on a pseudo-terminal."""

    def __init__(self) -> None:
        self.sims = [SimMks(address, machine=Machine(home_switch=-3.0)) for address in (1, 2)]
        self.line = VirtualLine(*self.sims, baudrate=115200)

    def moving(self) -> bool:
        now = asyncio.get_running_loop().time()
        return any(sim.moving(now) for sim in self.sims)

    @asynccontextmanager
    async def demo(self, stdout: int = PIPE, **options: object) -> AsyncIterator[asyncio.subprocess.Process]:
        """The demo on them, as soon as they move."""
        async with await self.line.serve_pty() as port:
            arguments = ("demo", "--port", port.path, "--baudrate", "115200", "--mks", "1", "--mks", "2")
            process = await asyncio.create_subprocess_exec(
                *COMMAND,
                *arguments,
                stdout=stdout,
                stderr=PIPE,
                **options,  # type: ignore[arg-type]
            )
            try:
                for _ in range(1000):
                    if self.moving():
                        break
                    await asyncio.sleep(0.02)
                yield process
            finally:
                if process.returncode is None:
                    process.kill()
                await process.wait()

    def check_stopped(self) -> None:
        assert not self.moving()
        assert [sim.watchdog_ms for sim in self.sims] == [0, 0]
        assert [sim.trips for sim in self.sims] == [[], []]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_the_demo_in_the_background_of_a_script_stops_every_axis_when_it_is_terminated(number: signal.Signals) -> None:
    async def main() -> None:
        plant = Plant()
        async with plant.demo(preexec_fn=as_in_the_background) as process:
            process.send_signal(number)
            output, errors = await asyncio.wait_for(process.communicate(), 30)
            assert b"Every axis was stopped and seen standing." in output
            assert b"Traceback" not in errors
            assert process.returncode == 130
            plant.check_stopped()

    in_real_time(main)


def test_a_signal_that_the_command_was_started_to_ignore_stays_ignored() -> None:
    async def main() -> None:
        plant = Plant()
        async with plant.demo(preexec_fn=nohup) as process:
            process.send_signal(signal.SIGHUP)
            await asyncio.sleep(0.3)
            assert process.returncode is None
            assert plant.moving()
            process.send_signal(signal.SIGINT)
            await asyncio.wait_for(process.communicate(), 30)
            plant.check_stopped()

    in_real_time(main)


def test_a_second_and_a_third_signal_do_not_keep_the_motors_from_being_stopped() -> None:
    async def main() -> None:
        plant = Plant()
        async with plant.demo() as process:
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
                process.send_signal(number)
                await asyncio.sleep(0.005)
            output, errors = await asyncio.wait_for(process.communicate(), 30)
            assert b"Every axis was stopped and seen standing." in output
            assert b"Traceback" not in errors
            assert process.returncode == 130
            plant.check_stopped()

    in_real_time(main)


def test_the_demo_whose_output_nobody_reads_any_more_stops_every_axis_and_ends() -> None:
    async def main() -> None:
        plant = Plant()
        ours, theirs = os.pipe()
        async with plant.demo(theirs) as process:
            os.close(theirs)
            os.close(ours)
            assert await asyncio.wait_for(process.wait(), 40) == 1
            assert process.stderr is not None
            assert await process.stderr.read() == b""
            plant.check_stopped()

    in_real_time(main)


SIM = (*COMMAND, "sim", "--mks", "1")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_sim_in_the_background_of_a_script_ends_when_it_is_terminated(number: signal.Signals) -> None:
    async def main() -> None:
        process = await asyncio.create_subprocess_exec(*SIM, stdout=PIPE, preexec_fn=as_in_the_background)
        assert process.stdout is not None
        await asyncio.wait_for(process.stdout.readline(), 20)
        process.send_signal(number)
        assert await asyncio.wait_for(process.wait(), 30) == 130

    in_real_time(main)


def test_a_signal_that_comes_just_before_the_loop_waits_wakes_it() -> None:
    """The system notes it in a file; what Python does about it waits until something wakes the loop."""
    before = signal.set_wakeup_fd(-1)

    async def command() -> int:
        loop, task, noted_in = asyncio.get_running_loop(), asyncio.current_task(), signal.set_wakeup_fd(-1)
        assert task is not None

        def come() -> None:
            time.sleep(0.1)
            loop.call_soon(task.cancel)  # as a handler would, had it been called; and this wakes nothing
            os.write(noted_in, bytes([signal.SIGTERM]))

        threading.Thread(target=come).start()
        begun = time.monotonic()
        try:
            await asyncio.sleep(10)
        except asyncio.CancelledError:
            return int(time.monotonic() - begun > 9)
        return 2

    assert process.run(command) == 0
    assert signal.set_wakeup_fd(before) == before


def test_sim_whose_output_nobody_reads_ends_without_a_word() -> None:
    async def main() -> None:
        ours, theirs = os.pipe()
        os.close(ours)
        process = await asyncio.create_subprocess_exec(*SIM, stdout=theirs, stderr=PIPE)
        os.close(theirs)
        _, errors = await asyncio.wait_for(process.communicate(), 20)
        assert process.returncode == 1
        assert errors == b""

    in_real_time(main)


def test_a_motor_that_was_not_seen_standing_counts_whatever_else_was_raised() -> None:
    async def fails(error: BaseException) -> int:
        error.add_note("MKS 1 could not be seen standing. Look at the machine.")
        raise error

    async def interrupted() -> int:
        signal.raise_signal(signal.SIGINT)
        try:
            await asyncio.sleep(9)
        except asyncio.CancelledError as cancelled:
            await fails(cancelled)
        return 0

    assert process.run(lambda: fails(MotionError("it was interrupted"))) == process.UNKNOWN
    assert process.run(interrupted) == process.UNKNOWN


def test_ctrl_c_while_python_ends_leaves_the_exit_code_as_it_is_in_real_time() -> None:
    """130 means that all motors were stopped. A command that could not stop them says 3, whoever presses what then."""
    program = (
        "import os, sys\n"
        "class Last:\n"
        "    def __del__(self, kill=os.kill, me=os.getpid()): kill(me, 2)\n"
        "sys.last = Last()\n"
        "from rs485bus.cli import main\n"
        "sys.argv = ['rs485bus', 'check', 'there_is_none.toml']\n"
        "main()\n"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, timeout=30).returncode == 2

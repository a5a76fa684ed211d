"""`rs485bus sniff` on a pseudo-terminal, while mbpoll asks virtual drives."""

import asyncio
import sys
from pathlib import Path

from rs485bus.capture import load
from rs485bus.sim import SimMks, SimUnit, SimZlac, VirtualLine
from tests.real.support import in_real_time, needs, posix, run

COMMAND = (sys.executable, "-m", "rs485bus")
MBPOLL = ("mbpoll", "-m", "rtu", "-b", "115200", "-P", "none", "-0", "-1", "-q")


@posix
@needs("mbpoll")
def test_it_tells_what_mbpoll_asks_and_what_virtual_drives_answer(tmp_path: Path) -> None:
    async def main() -> None:
        line = VirtualLine(SimMks(1), SimZlac(3), SimUnit(9, {0: 7}), baudrate=115200)
        capture = tmp_path / "cell.jsonl"
        arguments = ("--baudrate", "115200", "--record", str(capture), "--hex")
        async with await line.serve_pty() as port, await line.serve_tap() as tap:
            sniffing = await asyncio.create_subprocess_exec(
                *COMMAND,
                "sniff",
                tap.path,
                *arguments,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT,
            )
            for _ in range(300):
                if capture.exists():
                    break
                await asyncio.sleep(0.05)
            await asyncio.sleep(0.5)
            await run(*MBPOLL, "-a", "1", "-t", "3", "-r", "49", "-c", "3", port.path)
            await run(*MBPOLL, "-a", "3", "-t", "4", "-r", "8354", "-c", "13", port.path)
            await run(*MBPOLL, "-a", "9", "-t", "4", "-r", "0", port.path, "5")
            await asyncio.sleep(0.3)
            sniffing.terminate()
            output, _ = await asyncio.wait_for(sniffing.communicate(), 20)
        said = output.decode()
        assert sniffing.returncode == 130, said
        assert "Unit 1 speaks as MKS drives do." in said
        assert "1 MKS  poll    read position -> 0 counts" in said
        assert "3 ZLAC poll    read status word ... right torque" in said
        assert "09 06 00 00 00 05" in said
        assert "6 frames in" in said
        read = load(capture)
        assert read.header.by == "sniffer"
        assert [(each.address, each.outcome) for each in read.exchanges] == [(1, "reply"), (3, "reply"), (9, "reply")]

    in_real_time(main)


def test_it_can_be_tried_on_virtual_drives() -> None:
    async def main() -> None:
        said = await run(*COMMAND, "sniff", "--sim", "--mks", "5", "--seconds", "2")
        assert "Unit 5 speaks as MKS drives do." in said
        assert "5 MKS  command write absolute move" in said

    in_real_time(main)


@posix
def test_a_port_that_is_not_there_and_one_with_nothing_on_it(tmp_path: Path) -> None:
    async def main() -> None:
        process = await asyncio.create_subprocess_exec(
            *COMMAND, "sniff", "/dev/ttyNOPE", stderr=asyncio.subprocess.PIPE
        )
        _, error = await asyncio.wait_for(process.communicate(), 20)
        assert process.returncode == 4
        assert b"There is no port /dev/ttyNOPE" in error
        assert b"Traceback" not in error

    in_real_time(main)

"""`rs485bus read` and `write`: typed values of any device, on the virtual clock."""

import json

import pytest

from rs485bus.cli import session
from rs485bus.cli.process import WrongUse
from rs485bus.cli.raw import What, parse_number, run_read, run_write
from rs485bus.cli.session import Where
from rs485bus.sim import ModbusData, SimModbus
from tests.cli.support import invoke
from tests.integration.support import virtual

SIM = Where(sim=True)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> SimModbus:
    size = 20
    data = ModbusData(
        coils=dict.fromkeys(range(size), False),
        inputs={at: at % 2 == 0 for at in range(size)},
        registers=dict.fromkeys(range(size), 0),
        input_registers={at: 100 + at for at in range(size)},
    )
    made = SimModbus(7, data)
    monkeypatch.setattr(session, "virtual_drives", lambda: [made])
    return made


def what(**given: object) -> What:
    return What(**{"address": 7, "register": 4, **given})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "texts", "values"),
    [
        ("u16", ["65535", "0x10"], [65535, 16]),
        ("i16", ["-3"], [-3]),
        ("i32", ["-100000", "7"], [-100000, 7]),
        ("u32", ["4000000000"], [4000000000]),
        ("f32", ["2.5", "-0.5"], [2.5, -0.5]),
        ("f64", ["3.141592653589793"], [3.141592653589793]),
        ("i64", ["-5000000000"], [-5000000000]),
    ],
)
@pytest.mark.parametrize("order", ["big", "little"])
@virtual
async def test_what_is_written_is_read_back(
    kind: str, order: str, texts: list[str], values: list[float], device: SimModbus, capsys: pytest.CaptureFixture[str]
) -> None:
    there = what(kind=kind, order=order, count=len(values))
    assert await run_write(SIM, None, there, texts, multiple=False, verify=False) == 0
    capsys.readouterr()
    assert await run_read(SIM, None, there, None, True) == 0
    assert json.loads(capsys.readouterr().out) == {
        "address": 7,
        "table": "holding",
        "register": 4,
        "type": kind,
        "values": values,
    }


@virtual
async def test_the_word_order_is_that_of_the_device(device: SimModbus) -> None:
    await run_write(SIM, None, what(kind="u32", order="little"), ["0x00010002"], multiple=False, verify=True)
    assert [device.data.registers[at] for at in (4, 5)] == [2, 1]


@virtual
async def test_text_is_read_and_written(device: SimModbus, capsys: pytest.CaptureFixture[str]) -> None:
    await run_write(SIM, None, what(kind="string"), ["hello"], multiple=True, verify=False)
    await run_read(SIM, None, what(kind="string", count=4), None, False)
    assert "4 0x0004  hello" in capsys.readouterr().out


@virtual
async def test_bits_are_on_or_off(device: SimModbus, capsys: pytest.CaptureFixture[str]) -> None:
    await run_write(SIM, None, what(table="coil"), ["on", "0", "true"], multiple=False, verify=False)
    await run_read(SIM, None, what(table="coil", count=4), None, True)
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["values"] == [True, False, True, False]
    await run_read(SIM, None, what(table="discrete", count=2), None, False)
    assert "4 0x0004  on\n    5 0x0005  off" in capsys.readouterr().out


@virtual
async def test_input_registers_are_read_by_function_04(device: SimModbus, capsys: pytest.CaptureFixture[str]) -> None:
    await run_read(SIM, None, what(table="input", count=2), None, False)
    assert capsys.readouterr().out == "    4 0x0004  104  0x0068\n    5 0x0005  105  0x0069\n"


@virtual
async def test_a_write_to_everybody_says_that_nobody_answers(
    device: SimModbus, capsys: pytest.CaptureFixture[str]
) -> None:
    assert await run_write(SIM, None, what(address=0), ["5"], multiple=False, verify=False) == 0
    assert device.data.registers[4] == 5
    assert "nobody answers a broadcast" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"table": "coils"}, "There is no table 'coils'"),
        ({"kind": "int"}, "There is no type 'int'"),
        ({"order": "middle"}, "big .high word first. or little"),
        ({"table": "coil", "kind": "i32"}, "has no --type"),
        ({"table": "input"}, "Nothing can be written"),
        ({"address": 248}, "outside 1..247"),
    ],
)
def test_what_cannot_be_meant_is_refused(given: dict[str, object], words: str) -> None:
    with pytest.raises(WrongUse, match=words):
        what(**given).check(writes=True)


@pytest.mark.parametrize("text", ["70000", "-1", "1.5", "x"])
def test_what_is_no_value_of_the_type_is_refused(text: str) -> None:
    with pytest.raises(WrongUse, match="is no u16"):
        what().encoded([text])
    with pytest.raises(WrongUse):
        parse_number(text, "register")


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("read", "1", "5", "--sim"), 1, "MKS drives among them: --table input"),
        (("read", "4", "0x2001", "--sim"), 0, "8193 0x2001 4"),
        (("write", "3", "0x30", "-5", "--type", "i16", "--sim"), 0, "Written to unit 3"),
        (("write", "4", "0x2008", "-5", "--sim"), 2, "'-5' is no u16"),
        (("read", "4", "0x2001"), 2, "Say which drives"),
        (("read", "4", "0x2001", "--port", "/dev/ttyNOPE"), 2, "Say the baud rate"),
    ],
)
def test_as_a_user_calls_them(
    arguments: tuple[str, ...], code: int, words: str, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(str(tmp_path))
    result = invoke(*arguments)
    assert words in result.said
    assert result.returncode == code

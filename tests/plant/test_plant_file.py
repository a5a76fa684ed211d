"""A plant file: what it may say, and how each mistake is told."""

import pytest

from rs485bus.devices.mks import WorkMode
from rs485bus.plant import PlantFile, PlantFileError
from rs485bus.plant.building import try_out
from tests.plant.support import CELL


def problems(text: str) -> list[tuple[int | None, str, str]]:
    """The mistakes of a plant file: line, field and message."""
    with pytest.raises(PlantFileError) as caught:
        try_out(PlantFile.loads(text))
    return [(problem.line, problem.field, problem.message) for problem in caught.value.problems]


def test_a_plant_file_is_known_without_opening_anything() -> None:
    file = PlantFile.loads(CELL)
    assert file.name == "cell"
    assert list(file.axes) == ["x", "y", "left", "right"]
    assert file.axes["x"].options == {
        "units_per_turn": 8.0,
        "limits": (-20.0, 120.0),
        "mode": WorkMode.SR_VFOC,
    }
    assert file.axes["y"].bus == "main"
    assert file.vehicle is not None
    assert (file.vehicle.left, file.vehicle.right) == ("left", "right")
    assert [(address, sorted(filter(None, axes))) for address, axes in file.drives("main")] == [
        (1, []),
        (2, []),
        (3, ["left", "right"]),
    ]
    try_out(file)


@pytest.mark.parametrize(
    ("old", "new", "line", "field", "said"),
    [
        ("units_per_turn", "units_per_trun", 11, "axes.x.units_per_trun", 'Did you mean "units_per_turn"?'),
        ('family = "tlr"', 'familiy = "tlr"', 18, "axes.y.familiy", 'Did you mean "family"?'),
        ('family = "tlr"', 'family = "tlrr"', 18, "axes.y.family", 'Did you mean "tlr"?'),
        ("address = 2", "address = 1", 19, "axes.y.address", "is the address of x, too"),
        ("address = 2", "address = 300", 19, "axes.y.address", "300 is outside 1..247"),
        ("address = 2", 'address = "2"', 19, "axes.y.address", "must be a whole number, not '2'"),
        ("address = 2", "", 17, "axes.y.address", "it is missing; add a line address = ..."),
        ("address = 2", "address = 2\nwatchdog = 1.0", 20, "axes.y.watchdog", "have no watchdog"),
        ("address = 2", 'address = 2\nside = "left"', 20, "axes.y.side", "take this line out"),
        ("address = 2", "address = 2\nrpm = 9999", 20, "axes.y.rpm", "rpm 9999 is outside its range"),
        ('bus = "main"', 'bus = "mian"', 8, "axes.x.bus", 'Did you mean "main"?'),
        ('mode = "SR_VFOC"', 'mode = "SR"', 15, "axes.x.mode", "must be one of CR_OPEN"),
        ("[-20.0, 120.0]", "[120.0, -20.0]", 13, "axes.x.limits", "the wrong way round"),
        ("[-20.0, 120.0]", "120.0", 13, "axes.x.limits", "must be a list in brackets"),
        ("[-20.0, 120.0]", "[0,]", 13, "axes.x.limits", "must be a list of two values"),
        ("[-20.0, 120.0]", "[0, 1, 2]", 13, "axes.x.limits", "must be a list of two values"),
        ("watchdog = 1.0\nmode", "watchdog = 0\nmode", 14, "axes.x.watchdog", "greater than 0"),
        ("watchdog = 1.0\nmode", "watchdog = 0.001\nmode", 14, "axes.x.watchdog", "0.001 s is outside"),
        ('side = "right"', 'side = "rigth"', 31, "axes.right.side", 'side = "left" or side = "right"'),
        ('side = "right"', 'side = "left"', 30, "axes.right.address", "is the address of left, too"),
        (
            'side = "right"',
            'side = "right"\nwatchdog = 2.0',
            32,
            "axes.right.watchdog",
            "another one than that of left",
        ),
        ('["x", "y"]', '["x", "yy"]', 35, "groups.xy.axes", 'there is no axis "yy". Did you mean "y"?'),
        ('["x", "y"]', '["x", "x"]', 35, "groups.xy.axes", "named twice"),
        ("[groups.xy]", "[groups.x]", 34, "groups.x", 'there is an axis "x" already'),
        ("[groups.xy]", "[group.xy]", 34, "group", 'Did you mean "groups"?'),
        ("track = 0.4", "", 37, "vehicle.track", "it is missing"),
        ("track = 0.4", 'track = 0.4\nleft = "x"', 40, "vehicle.left", "is no axis of family"),
        ("baudrate = 115200", "", 3, "buses.main", "Say the baud rate of /dev/ttyUSB0"),
        ("baudrate = 115200", "baudrate = 3", 5, "buses.main.baudrate", "baudrate 3 is outside"),
        (
            "baudrate = 115200",
            "baudrate = 115200\nretries = 99",
            6,
            "buses.main.retries",
            "retries 99 is outside 0..10",
        ),
        ("baudrate = 115200", "baudrate = 115200\nretires = 1", 6, "buses.main.retires", 'Did you mean "retries"?'),
        ('"/dev/ttyUSB0"', '"192.168.1.5"', 4, "buses.main.port", "socket://192.168.1.5:4196"),
        ('"/dev/ttyUSB0"', "/dev/ttyUSB0", None, "", "is no TOML"),
        ("[axes.y]", '[axes."y 1"]', 17, "axes.y 1", "begins with a letter"),
        ("[axes.y]", "[axes.groups]", 17, "axes.groups", "is used by the plant itself"),
    ],
)
def test_each_mistake_is_told_with_its_line_its_field_and_what_to_do(
    old: str, new: str, line: int | None, field: str, said: str
) -> None:
    assert old in CELL
    text = CELL.replace(old, new, 1)
    if field:
        assert (line, field) in [(found[0], found[1]) for found in problems(text)]
        assert any(said in message for _, _, message in problems(text))
    else:
        with pytest.raises(PlantFileError, match=said):
            PlantFile.loads(text)


def test_a_bus_that_is_not_there_is_told_beside_what_else_is_wrong_with_an_axis() -> None:
    text = CELL.replace('bus = "main"', 'bus = "mian"', 1).replace("units_per_turn = 8.0", 'units_per_turn = "8"', 1)
    text = text.replace('family = "mks"', 'family = "msk"', 1)
    assert {"axes.x.bus", "axes.x.family"} <= {field for _, field, _ in problems(text)}
    text = text.replace('"msk"', '"mks"')
    assert {"axes.x.bus", "axes.x.units_per_turn"} <= {field for _, field, _ in problems(text)}

"""A share of what `python -m rs485bus.sim.relative_moves` runs in full."""

from rs485bus.sim.campaigns.moves.compare import report, run
from rs485bus.sim.campaigns.moves.plant import STEP, Ledger, Tally

MOVES = 25


def test_every_shaft_stands_where_the_sum_of_its_acknowledged_moves_says_though_frames_are_lost() -> None:
    tally = run("rs485bus", 1, MOVES)
    assert (tally.off, tally.astray) == (0, 0)
    assert tally.shafts == 6
    assert tally.acknowledged >= 0.95 * 6 * MOVES


def test_the_same_moves_by_pymodbus_client_lead_shafts_astray() -> None:
    tally = run("pymodbus", 1, MOVES)
    assert tally.astray > 0
    assert tally.off > 0
    assert "pymodbus" in report({"pymodbus": tally})


def test_without_losses_nobody_goes_astray() -> None:
    for who in ("rs485bus", "pymodbus"):
        tally = run(who, 1, 5, lost=0.0)
        assert (tally.acknowledged, tally.failed, tally.off, tally.astray) == (30, 0, 0, 0)


def test_a_move_that_went_twice_is_found() -> None:
    tally, turns = Tally(), [0.0]
    ledger = Ledger(tally, lambda: turns[0])
    turns[0] = 2 * STEP
    ledger.acknowledged(STEP)
    ledger.close()
    assert (tally.off, tally.astray, tally.worst) == (1, 1, STEP)

"""Everything asked for is planned, in an order that drift hits alike."""

from dataclasses import replace

from benchmarks.plan import QUICK, ROWS, Scale
from benchmarks.setting import ROUND, workload


def test_libraries_take_turns_within_a_repetition() -> None:
    plan = list(ROWS["share"](replace(Scale(), repeats=2, baudrates=(38400,), units=(8,))))
    libraries = list(Scale().libraries)
    assert [measurement.task.library for measurement in plan] == 2 * libraries


def test_every_row_is_planned_in_a_glance_too() -> None:
    assert all(list(plan(QUICK)) for plan in ROWS.values())


def test_blocking_libraries_are_not_asked_to_queue() -> None:
    asked = {measurement.task.library for row in ("stop", "waiting") for measurement in ROWS[row](Scale())}
    assert asked.isdisjoint({"minimalmodbus", "floor"})


def test_the_workload_asks_every_unit_equally_often_and_writes_every_fourth_time() -> None:
    for units in (1, 8, 31):
        steps = workload(units)
        assert {step.unit for step in steps} == set(range(1, units + 1))
        assert len(steps) == ROUND * units
        assert sum(step.writes for step in steps) * ROUND == len(steps)

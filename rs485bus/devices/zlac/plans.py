"""By which steps a ZLAC8015D is told what. Source: ZLAC8015D RS485 V1.06, 3. Pure.

Both wheels share the control word, the mode and the way of starting. A mode is entered as the routines of 3 do it:
mode, ramps, enable, target; but its targets are made harmless first, so that neither the change nor the enabling goes
on with an old one. A wheel that needs another mode waits until the other one stands.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import control, read, write, write_together, write_twins
from rs485bus.devices.zlac.known import KnownZlac
from rs485bus.devices.zlac.setup import set_up
from rs485bus.devices.zlac.values import ControlMode, ControlWord, Side, Synchrony, ZeroReset
from rs485bus.errors import DriveFault, LimitExceeded, NotEnabled, NotSupported
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Ask, Know, OthersStand, Plan, Stand, Start
from rs485bus.motion.profile import is_speed
from rs485bus.motion.state import Fact
from rs485bus.motion.streaming import STEP
from rs485bus.wire.frames import Request, payload
from rs485bus.wire.registers import Repeat

_CLOSE = 0.05
"""By which part of it a ramp may be longer or shorter than it should be."""
_UNDER_WAY = 0.03
"""Seconds until a wheel has heard what is computed now."""
Targets = tuple[r.Twin[int], Mapping[int, int]]
"""What exists once for each wheel, and values for some of them, by axis."""
_SIDES = tuple(Side)

# Enabling


def enable(drive: KnownZlac) -> Plan[None]:
    """Hold both wheels, with no target left from before. Raises `DriveFault`, `NotEnabled`."""
    yield Know((Fact.MARK,), afresh=True)
    yield from set_up(drive)
    yield Know((Fact.FAULT, Fact.ENABLED), afresh=True)
    check_faults(drive)
    if drive.enabled and (drive.ready or drive.motion.may_move) and not drive.paused:
        return
    yield from _zero_targets(drive)
    yield Ask(write(drive.address, r.MODE, ControlMode.VELOCITY))
    yield Ask(control(drive.address, ControlWord.ENABLE))
    yield Know((Fact.FAULT, Fact.ENABLED), afresh=True)
    check_faults(drive)
    if not drive.enabled:
        raise NotEnabled(f"{drive.name} was told to enable its motors. {(yield from _why_not(drive))}")
    drive.paused, drive.ready = False, True


def resume(drive: KnownZlac) -> Plan[None]:
    """Enable it again after a controlled stop that only an emergency stop could make."""
    if drive.paused:
        yield from enable(drive)


def release(drive: KnownZlac, *axes: int) -> Plan[None]:
    """Let go of both wheels (0x07), for some of them; the others stand first."""
    yield from _alone(drive, None, axes)
    drive.paused = False
    yield Ask(control(drive.address, ControlWord.RELEASE))


def clear_faults(drive: KnownZlac) -> Plan[None]:
    """Clear the errors of both wheels (0x06). Raises `DriveFault` where they are there again."""
    yield from _zero_targets(drive)
    yield Ask(control(drive.address, ControlWord.CLEAR_FAULT))
    yield Know((Fact.FAULT,), afresh=True)
    check_faults(drive)


def check_faults(drive: KnownZlac) -> None:
    """Raise `DriveFault` if either wheel reports an error."""
    fault = drive.state.axes[0].value(Fact.FAULT)
    if fault:
        raise DriveFault(f"{drive.name} reports: {fault}. {drive.fault_remedy}")


def _why_not(drive: KnownZlac) -> Plan[str]:
    if not drive.is_in_emergency_stop:
        return "It says that it is not enabled."
    inputs, _ = r.PORTS.decode(payload((yield Ask(read(drive.address, r.PORTS)))))
    reversed_, *_ = r.TERMINALS.decode(payload((yield Ask(read(drive.address, r.TERMINALS)))))
    active = inputs ^ reversed_
    return f"It is in emergency stop, with inputs {active!r}. Release its emergency-stop input (0x2017, 0x2018)."


def _zero_targets(drive: KnownZlac) -> Plan[None]:
    yield Ask(write_twins(drive.address, (r.TARGET_VELOCITY, 0, 0), (r.TARGET_POSITION, 0, 0)))
    yield Ask(write_twins(drive.address, (r.TARGET_TORQUE, 0, 0)))


# Modes


def enter(drive: KnownZlac, mode: ControlMode, synchrony: Synchrony, axes: Iterable[int]) -> Plan[None]:
    """Have the drive in a mode, for wheels that stand. Raises `NotSupported`."""
    memory, address = drive.memory, drive.address
    while memory.value(r.MODE) is not mode or memory.value(r.SYNCHRONY) is not synchrony:
        yield from _alone(drive, mode, axes)
        if memory.value(r.SYNCHRONY) is not synchrony:
            yield Ask(write(address, r.SYNCHRONY, synchrony))
        if memory.value(r.MODE) is not mode:
            yield from _neutral(drive, mode)
            yield Ask(write(address, r.MODE, mode))
            yield Ask(control(address, ControlWord.ENABLE))


def check_alone(drive: KnownZlac, mode: ControlMode | None, axes: Iterable[int]) -> None:
    """Raise `NotSupported` where a wheel that takes no part keeps a speed or a torque in another mode."""
    for axis, side in enumerate(Side):
        kept = drive.kept(axis)
        if axis not in axes and kept is not None and kept is not mode:
            raise NotSupported(
                f"{drive.name}: both wheels share one control mode, and the {side.name.lower()} one keeps a "
                f"{kept.name.lower()}. Stop that one first."
            )


def _alone(drive: KnownZlac, mode: ControlMode | None, axes: Iterable[int]) -> Plan[None]:
    """Wait until the wheels that take no part stand."""
    check_alone(drive, mode, axes)
    while any(state.motion.may_move for axis, state in enumerate(drive.state.axes) if axis not in axes):
        yield OthersStand()
        check_alone(drive, mode, axes)


def _neutral(drive: KnownZlac, mode: ControlMode) -> Plan[None]:
    """Give it targets that leave standing wheels where they are."""
    twin, values = r.TARGET_POSITION, (0, 0)
    if mode is ControlMode.POSITION_ABSOLUTE:
        yield Know((Fact.POSITION,), afresh=True)
        left, right = (axis.last(Fact.POSITION).value for axis in drive.state.axes)
        values = _in_range(left), _in_range(right)
    elif not mode.is_position:
        twin = r.TARGET_VELOCITY if mode is ControlMode.VELOCITY else r.TARGET_TORQUE
    yield Ask(write_twins(drive.address, (twin, *values)))


def _in_range(counts: int) -> int:
    return max(-r.MAX_ABSOLUTE, min(r.MAX_ABSOLUTE, counts))


# What it is told to do


def move(drive: KnownZlac, wanted: Mapping[int, tuple[int, MotionParameters]]) -> Plan[None]:
    """Send wheels to positions, in counts."""
    relative = any(abs(target) > r.MAX_ABSOLUTE for target, _ in wanted.values())
    mode = ControlMode.POSITION_RELATIVE if relative else ControlMode.POSITION_ABSOLUTE
    synchrony = Synchrony.SYNCHRONOUS if len(wanted) == len(Side) else Synchrony.ASYNCHRONOUS
    yield from resume(drive)
    yield from enter(drive, mode, synchrony, wanted)
    times = {axis: parameters.ramp_code for axis, (_, parameters) in wanted.items()}
    yield from put(drive, (r.ACCELERATION_TIME, times), (r.DECELERATION_TIME, times))
    scale = drive.abilities[0].resolution if drive.options.scaled_position_speed else 1
    speeds = {axis: round(parameters.rpm) * scale for axis, (_, parameters) in wanted.items()}
    yield from put(drive, (r.POSITION_SPEED, speeds))
    counts = {axis: target for axis, (target, _) in wanted.items()}
    if relative:
        yield Know((Fact.POSITION,), afresh=True)
        starts = {axis: drive.state.axes[axis].last(Fact.POSITION).value for axis in counts}
        counts = {axis: target - starts[axis] for axis, target in counts.items()}
    yield Ask(_targets(drive, r.TARGET_POSITION, counts))
    stopping = max(parameters.rpm / parameters.acceleration for _, parameters in wanted.values())
    shows_after = max(
        drive.state.axes[axis].rule.shows_after(parameters.acceleration / 60 * drive.abilities[axis].counts_per_turn)
        for axis, (_, parameters) in wanted.items()
    )
    yield Start(drive.start_word(wanted), _quick_stop(drive), stopping, once=relative, shows_after=shows_after)


def run(drive: KnownZlac, wanted: Mapping[int, tuple[float, MotionParameters]]) -> Plan[None]:
    """Have wheels turn at speeds, in rpm, in the drive's direction."""
    if drive.mode is not ControlMode.VELOCITY:
        check_alone(drive, ControlMode.VELOCITY, wanted)
        yield Stand()
    yield from resume(drive)
    yield from enter(drive, ControlMode.VELOCITY, Synchrony.ASYNCHRONOUS, wanted)
    yield Know((Fact.SPEED,))
    times = {
        axis: _ramp_time(drive, axis, change_to(drive, axis, rpm), parameters.acceleration)
        for axis, (rpm, parameters) in wanted.items()
    }
    yield from put(drive, (r.ACCELERATION_TIME, times), (r.DECELERATION_TIME, times))
    steps = {axis: round(rpm * drive.abilities[axis].resolution) for axis, (rpm, _) in wanted.items()}
    for axis, (rpm, parameters) in wanted.items():
        drive.keep(axis, ControlMode.VELOCITY if rpm else None, parameters.acceleration)
    # The same speed again is the same, so it may be said as often as it takes.
    start, stop = (_targets(drive, r.TARGET_VELOCITY, each) for each in (steps, dict.fromkeys(wanted, 0)))
    yield Start(start, stop, max(times.values()) / 1000, repeat=Repeat.SAFE)


def stream(drive: KnownZlac, axes: Iterable[int]) -> Plan[None]:
    """Have it ready for speeds that are told wheels as they come."""
    if drive.mode is not ControlMode.VELOCITY:
        check_alone(drive, ControlMode.VELOCITY, axes)
        yield Stand()
    yield from resume(drive)
    yield from enter(drive, ControlMode.VELOCITY, Synchrony.ASYNCHRONOUS, axes)
    yield Know((Fact.SPEED,), afresh=True)
    yield from put(drive, (r.ACCELERATION_TIME, {}), (r.DECELERATION_TIME, {}))


def setpoints(drive: KnownZlac, speeds: Mapping[int, float], acceleration: float) -> tuple[Request, ...]:
    """The frames that tell wheels of a stream their next speeds, with a ramp that is as gentle as the stream's.

    A stream makes steps. Where a ramp time is for any change, each is spread over the time of two steps: however small
    it is, it is no quicker than the ramp.
    """
    steps, times = {}, {}
    for axis, rpm in speeds.items():
        ability = drive.abilities[axis]
        steps[axis] = math.trunc(rpm * ability.resolution + math.copysign(1e-6, rpm))
        seconds = drive.options.ramp_rpm / acceleration if drive.options.ramp_rpm else 2 * STEP
        time = 0.0 if math.isinf(acceleration) else 1000 * seconds
        times[axis] = math.ceil(min(r.MAX_RAMP, time - 1e-6))
        drive.keep(axis, ControlMode.VELOCITY, acceleration)
    targets = _targets(drive, r.TARGET_VELOCITY, steps)
    ramps, held = [], True
    for twin in (r.ACCELERATION_TIME, r.DECELERATION_TIME):
        old = [drive.memory.value(twin.of(side)) for side in Side]
        left, right = (times.get(axis, old[axis] or 0) for axis in range(len(Side)))
        held = held and [left, right] == old
        ramps.append((twin, left, right))
    return (targets,) if held else (write_twins(drive.address, *ramps), targets)


def push(drive: KnownZlac, wanted: Mapping[int, tuple[int, int | None]]) -> Plan[None]:
    """Have wheels push: (mA, mA/s or None) in the drive's direction."""
    if drive.mode is not ControlMode.TORQUE:
        check_alone(drive, ControlMode.TORQUE, wanted)
        yield Stand()
    yield from resume(drive)
    yield from enter(drive, ControlMode.TORQUE, Synchrony.ASYNCHRONOUS, wanted)
    slopes = {axis: slope for axis, (_, slope) in wanted.items() if slope is not None}
    if slopes:
        yield from put(drive, (r.TORQUE_SLOPE, slopes))
    for axis in wanted:
        drive.keep(axis, ControlMode.TORQUE)
    torques = {axis: torque for axis, (torque, _) in wanted.items()}
    yield Start(_targets(drive, r.TARGET_TORQUE, torques), _quick_stop(drive), 0.0, repeat=Repeat.SAFE)


def zero(drive: KnownZlac, axis: int) -> Plan[None]:
    """Have a wheel count from zero where it stands."""
    yield Know((Fact.ENABLED,))
    if drive.enabled:
        # With a position loop closed, a counter that jumps could make the wheel jump. The manual speaks of 0x2005 in
        # position mode; a drive that needs that gets a mode in which the target is a way of nothing.
        relative = drive.options.zero_in_position_mode
        mode = ControlMode.POSITION_RELATIVE if relative else ControlMode.VELOCITY
        yield from enter(drive, mode, Synchrony.ASYNCHRONOUS, (axis,))
    # The way until now is known; the counter begins anew.
    yield Know((Fact.POSITION,), afresh=True)
    # First the counter, then where absolute targets count from: right whether or not one brings the other along.
    # Setting a standing wheel to zero twice is setting it once.
    yield Ask(write(drive.address, r.CLEAR_POSITION, ZeroReset(_SIDES[axis])))
    yield Ask(write(drive.address, r.RESET_ZERO, ZeroReset(_SIDES[axis])))
    yield Ask(write_together(drive.address, (r.CLEAR_POSITION, ZeroReset.NONE), (r.RESET_ZERO, ZeroReset.NONE)))


# Ramps and targets


def put(drive: KnownZlac, *wanted: Targets) -> Plan[None]:
    """Write what lies side by side for both wheels, in one frame, unless the drive holds it already."""
    memory = drive.memory
    if any(memory.value(twin.of(side)) is None for twin, _ in wanted for side in Side):
        yield Ask(read(drive.address, r.CONTROL_BLOCK))
    pairs, held = [], True
    for twin, values in wanted:
        old = [memory.value(twin.of(side)) or 0 for side in Side]
        left, right = (values.get(axis, old[axis]) for axis in range(len(Side)))
        held = held and old == [left, right]
        pairs.append((twin, left, right))
    if not held:
        yield Ask(write_twins(drive.address, *pairs))


def change_to(drive: KnownZlac, axis: int, rpm: float) -> float:
    """The change of speed, in rpm, that it is for a wheel to turn at a speed: from the one that it had when it was last
    asked, or can have come to since on its way to the one that it was told, whichever is further away."""
    state = drive.state.axes[axis]
    if not state.motion.may_move:
        return abs(rpm)
    told = (drive.memory.told(r.TARGET_VELOCITY.of(_SIDES[axis])) or 0) / drive.abilities[axis].resolution
    asked, rate = state.last(Fact.SPEED), drive.accelerations.get(axis) or math.inf
    speed, most = asked.value or 0.0, rate * max(0.0, drive.now() + _UNDER_WAY - asked.at)
    if is_speed(speed, told):
        return abs(rpm - told)
    reached = told if abs(told - speed) <= most else speed + math.copysign(most, told - speed)
    return max(abs(rpm - reached), abs(rpm - speed))


def frames_for_stop(drive: KnownZlac, axes: tuple[int, ...]) -> tuple[Request, ...]:
    """What stops wheels that turn at speeds: target 0, with the ramp that fits the speed that they have."""
    memory, address = drive.memory, drive.address
    held = {side: memory.value(r.DECELERATION_TIME.of(side)) for side in Side}
    times = dict(held)
    for axis in axes:
        side, acceleration = _SIDES[axis], drive.accelerations.get(axis)
        if acceleration is not None and drive.state.axes[axis].motion.may_move:
            times[side] = _ramp_time(drive, axis, change_to(drive, axis, 0.0), acceleration, refuse=False)
    targets = _targets(drive, r.TARGET_VELOCITY, dict.fromkeys(axes, 0))
    left, right = times.values()
    if None in held.values() or left is None or right is None or all(map(_is_close, held.values(), times.values())):
        return (targets,)
    rest = [memory.value(twin.of(side)) for twin in (r.QUICK_STOP_TIME, r.TORQUE_SLOPE) for side in Side]
    if len(axes) < len(Side) or None in rest:
        # What the other wheel is told meanwhile must not be undone by a repetition of this.
        return write_twins(address, (r.DECELERATION_TIME, left, right)), targets
    quick_left, quick_right, slope_left, slope_right = (value or 0 for value in rest)
    return (
        write_twins(
            address,
            (r.DECELERATION_TIME, left, right),
            (r.QUICK_STOP_TIME, quick_left, quick_right),
            (r.TORQUE_SLOPE, slope_left, slope_right),
            (r.TARGET_VELOCITY, 0, 0),
        ),
    )


def _is_close(held: int | None, wanted: int | None) -> bool:
    return abs((held or 0) - (wanted or 0)) <= _CLOSE * (wanted or 0)


def _ramp_time(drive: KnownZlac, axis: int, change: float, acceleration: float, *, refuse: bool = True) -> int:
    """The ramp time, in ms, for a change of speed. A little more than a ramp may last is the longest one."""
    time = drive.abilities[axis].ramp_time(change, acceleration)
    if refuse and time > r.MAX_RAMP * (1 + _CLOSE):
        raise LimitExceeded(
            f"{drive.name} {_SIDES[axis].name.lower()}: to change its speed by {change:.4g} rpm at {acceleration:g} "
            f"rpm/s takes {time / 1000:.4g} s, and a ramp lasts at most {r.MAX_RAMP / 1000} s. Accelerate faster, or "
            "change it in steps."
        )
    return min(r.MAX_RAMP, round(time))


def _quick_stop(drive: KnownZlac) -> Request:
    """What stops both wheels, whatever they do."""
    return control(drive.address, ControlWord.EMERGENCY_STOP)


def _targets(drive: KnownZlac, twin: r.Twin[int], wanted: Mapping[int, int]) -> Request:
    """One frame for both wheels, or for one."""
    if len(wanted) == len(Side):
        return write_twins(drive.address, (twin, wanted[0], wanted[1]))
    ((axis, value),) = wanted.items()
    return write(drive.address, twin.of(_SIDES[axis]), value)

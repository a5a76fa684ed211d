"""Clients that repeat themselves and whose clocks are wrong, messages that are late, stops, silences, and restarts in
which the clock is set, in any order."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, rule

from rs485bus.service.decisions import Asker
from rs485bus.service.schema import Request
from tests.service.office import AXES, TOPICS, Office

CLIENTS = st.sampled_from("ab")
NAMES = st.sampled_from(["x", "y", "xy"])


class Clients(RuleBasedStateMachine):
    """Whatever happens, each request is begun once at most, by who commands, and never after a stop that it is older
    than; and whoever asks is told one end, always the same."""

    requests = Bundle("requests")

    def __init__(self) -> None:
        super().__init__()
        self.office = Office()
        self.leases: dict[str, int] = {}
        self.made: dict[str, tuple[str, Request]] = {}
        self.halts_when_said: dict[str, int] = {}
        self.repeats = 0
        self.seen_halts = 0
        self.begun_before = 0
        self.killed: set[str] = set()

    @rule(client=CLIENTS, name=NAMES, seconds=st.sampled_from([0.3, 1.0, 30.0]))
    def takes_control(self, client: str, name: str, seconds: float) -> None:
        said = self.office.request(
            "plant", "take_control", client, lease=self.leases.get(client), args={"axes": [name], "seconds": seconds}
        )
        answer = self.office.answer(said.id)
        if answer.outcome == "done":
            self.leases[client] = answer.value["lease"]

    @rule(
        target=requests,
        client=CLIENTS,
        name=NAMES,
        late=st.sampled_from([0, 0, 0.1, 0.6]),
        at=st.booleans(),
        ahead=st.sampled_from([0, 0, 0, 0.3, 7]),
    )
    def says(self, client: str, name: str, late: float, at: bool, ahead: float) -> str:
        now = self.office.now + ahead
        said = Request(
            id=f"m{len(self.made)}",
            client=client,
            lease=self.leases.get(client),
            sent=now,
            expires=now + 0.5,
            at=now + 0.3 if at else None,
        )
        self.made[said.id] = (name, said)
        if not ahead:  # of who is ahead nobody knows when it was said
            self.halts_when_said[said.id] = len(self.office.halts)
        self.office.wait(late)
        self.office.say(name, "home", said)
        return said.id

    @rule(request=requests)
    def says_again(self, request: str) -> None:
        name, said = self.made[request]
        self.repeats += 1
        self.office.say(name, "home", said, asker=Asker(TOPICS.reply(said.client), f"again {self.repeats}".encode()))

    @rule(client=CLIENTS)
    def shows_presence(self, client: str) -> None:
        if client in self.leases:
            self.office.presence(self.leases[client], client)

    @rule(axes=st.sampled_from([("x",), ("y",), ()]), emergency=st.booleans())
    def stops(self, axes: tuple[str, ...], emergency: bool) -> None:
        self.office.stop(*axes, emergency=emergency)

    @rule(request=requests)
    def cancels(self, request: str) -> None:
        self.office.request("plant", "cancel", args={"request": request})

    @rule(client=CLIENTS)
    def breaks_off(self, client: str) -> None:
        self.office.gone(client)

    @rule()
    def loses_the_broker(self) -> None:
        self.office.do(self.office.desk.cut_off("the service has lost the broker", self.office.now))

    @rule(seconds=st.sampled_from([0.01, 0.2, 0.7, 100.0]))
    def time_passes(self, seconds: float) -> None:
        self.office.wait(seconds)

    @rule(count=st.sampled_from([1, 2, None]))
    def the_ledger_is_written(self, count: int | None) -> None:
        self.office.write(count)

    @rule()
    def something_ends(self) -> None:
        if self.office.running:
            self.office.end(next(iter(self.office.running)))

    @rule(pause=st.sampled_from([0.1, 0.1, 50.0, -0.5, -20.0]))
    def the_service_is_killed(self, pause: float) -> None:
        """It is started again after a pause; the clock may have been set meanwhile."""
        self.killed |= set(self.office.running)
        held = {axis for request in self.office.running for axis in AXES[self.made[request][0]]}
        _, axes = self.office.restart(pause)
        assert held <= axes, "what moved when the service was killed must be known to the next one"

    @invariant()
    def nothing_is_begun_twice(self) -> None:
        begun = [request for request, _ in self.office.begun]
        assert len(begun) == len(set(begun))

    @invariant()
    def nothing_is_begun_after_a_stop_that_it_is_older_than_nor_without_control(self) -> None:
        for request, _ in self.office.begun[self.begun_before :]:
            name, said = self.made[request]
            since = self.halts_when_said.get(request, self.office.halts_before[request])
            for halt, _ in self.office.halts[since : self.office.halts_before[request]]:
                assert not halt.axes & AXES[name]
            lease = self.office.desk.leases.get(said.lease, said.client)
            assert request not in self.office.running or (lease is not None and AXES[name] <= lease.axes)
        self.begun_before = len(self.office.begun)

    @invariant()
    def what_is_said_is_so_and_said_alike(self) -> None:
        for request in self.made:
            outcomes = {answer.outcome for answer in self.office.answers(request)}
            assert len(outcomes) <= 1
            begun = self.office.times_begun(request)
            assert not (outcomes == {"refused"} and begun)
            assert not (outcomes == {"done"} and not begun)

    def teardown(self) -> None:
        self.office.wait(1)
        while self.office.running:
            self.something_ends()
        self.office.write()
        for request in self.made:
            self.says_again(request)
        self.office.write()
        for request in self.made:
            assert self.office.answers(request), "whoever asks is told an end"
            if self.office.times_begun(request):
                assert self.office.answers(request)[-1].outcome != "refused"
        self.what_is_said_is_so_and_said_alike()
        askers = [asker for asker, answer in self.office.said if answer.outcome != "begun"]
        assert len(askers) == len(set(askers)), "nobody is answered twice"


Clients.TestCase.settings = settings(max_examples=60, stateful_step_count=40)
TestClients = Clients.TestCase

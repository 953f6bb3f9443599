"""What was requested, what was reported, and in which window of the judge's own clock."""

import dataclasses
import datetime
import itertools
import threading
import time


@dataclasses.dataclass
class Part:
    """One output of a command: what was requested, and what was reported."""

    relay: str
    # The state it was to have at once; None: the opposite of the present one.
    want: object
    told: dict = dataclasses.field(default_factory=dict)


@dataclasses.dataclass
class Claim:
    """A command. Unless `answered`, the connection was lost."""

    kind: str
    parts: list
    since: float
    until: float = 0.0
    answered: bool = False
    status: int = 0
    verify: bool = True
    # For pulses and leases: how long they last, and who times them.
    seconds: float = 0.0
    by: str = ""
    is_raw: bool = False
    all_or_nothing: bool = False
    undone: bool = False
    key: str = ""
    who: str = ""
    number: int = 0

    def did_nothing(self, part):
        """Whether the answer said that nothing was done."""
        if not self.answered or not is_error(part):
            return False
        return not part.told.get("may_have_acted") and not is_undone(part)

    def is_done(self, part):
        """Whether the answer said that it was done."""
        return self.answered and "confirmed" in part.told and not is_error(part)

    def is_done_or_renewed(self, part):
        """Whether the answer said that it was done, or renewed."""
        return self.is_done(part) or self.answered and bool(part.told.get("renewed"))

    def words(self):
        """A line for the report."""
        parts = ", ".join(f"{p.relay}={p.want} -> {p.told}" for p in self.parts)
        return (f"#{self.number} {self.who} {self.kind} [{self.since:.3f}, {self.until:.3f}] "
                f"status {self.status} {parts}")


def is_error(part):
    """Whether the answer reports an output as not switched, or as restored."""
    return "code" in part.told


def is_undone(part):
    """Whether the answer reports it as undone."""
    return part.told.get("code") == "E0456"


@dataclasses.dataclass
class Reading:
    """A value that was reported as good, and since when it is claimed to have been true."""

    path: str
    value: bool
    since: float
    until: float
    how: str


class Book:
    """All claims of a run."""

    def __init__(self):
        self.claims, self.readings = [], []
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        # Wall clock minus our clock, as measured at several times.
        self.offsets = [time.time() - time.monotonic()]

    def begin(self, claim):
        """Records a command that is being sent."""
        with self._lock:
            claim.number = next(self._numbers)
            self.claims.append(claim)
        return claim

    def mark_clock(self):
        """Records the difference of the two clocks."""
        self.offsets.append(time.time() - time.monotonic())

    def mono(self, text):
        """The window of our clock that contains a time of the wall clock."""
        wall = wall_time(text) if isinstance(text, str) else text
        return wall - max(self.offsets), wall - min(self.offsets) + 0.001


def wall_time(text):
    """RFC 3339 as seconds since 1970."""
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def take_answer(claim, status, answer):
    """Adds the answer to the claim."""
    claim.answered, claim.status = True, status
    if status != 200:
        for part in claim.parts:
            part.told = trimmed(answer)
        return
    if "results" in answer:
        by_path = {result["path"]: result for result in answer["results"]}
        claim.undone = answer.get("undone", False)
        for part in claim.parts:
            told = dict(by_path.get(part.relay, {}))
            error = told.pop("error", None)
            part.told = trimmed(told) | (trimmed(error) if error else {})
    elif "set" in answer:
        for part in claim.parts:
            told = answer["set"].get(part.relay.split(".")[1], {})
            part.told = trimmed(told) | trimmed(answer)
    else:
        for part in claim.parts:
            part.told = trimmed(answer)


KEPT = ("value", "before", "confirmed", "audit", "code", "may_have_acted", "by", "ms", "until",
        "renewed", "reason", "read_then_set")


def trimmed(answer):
    """The parts of an answer that are judged."""
    kept = {key: answer[key] for key in KEPT if answer.get(key) is not None}
    if "reason" in kept:
        kept["reason"] = str(kept["reason"])[:80]
    return kept

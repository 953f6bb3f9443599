"""What was asked, what was told, and in which window of the judge's own clock."""

import dataclasses
import datetime
import itertools
import threading
import time


@dataclasses.dataclass
class Part:
    """One output of a command: what was wanted of it, and what was told."""

    relay: str
    # What it was to become at once; none: the other state.
    want: object
    told: dict = dataclasses.field(default_factory=dict)


@dataclasses.dataclass
class Claim:
    """A command. Unless `answered`, whoever was asked went away."""

    kind: str
    parts: list
    since: float
    until: float = 0.0
    answered: bool = False
    status: int = 0
    verify: bool = True
    # Of pulses and leases: how long it lasts, and who times it.
    seconds: float = 0.0
    by: str = ""
    is_raw: bool = False
    all_or_nothing: bool = False
    undone: bool = False
    key: str = ""
    who: str = ""
    number: int = 0

    def did_nothing(self, part):
        """Whether it was told that nothing was done."""
        if not self.answered or not is_error(part):
            return False
        return not part.told.get("may_have_acted") and not is_undone(part)

    def is_done(self, part):
        """Whether it was told that it was done."""
        return self.answered and "confirmed" in part.told and not is_error(part)

    def is_done_or_renewed(self, part):
        """Whether it was told to be done, or to go on."""
        return self.is_done(part) or self.answered and bool(part.told.get("renewed"))

    def words(self):
        """For the report."""
        parts = ", ".join(f"{p.relay}={p.want} -> {p.told}" for p in self.parts)
        return (f"#{self.number} {self.who} {self.kind} [{self.since:.3f}, {self.until:.3f}] "
                f"status {self.status} {parts}")


def is_error(part):
    """Whether an output was not switched, or is not any more."""
    return "code" in part.told


def is_undone(part):
    """Whether it was told to have been taken back."""
    return part.told.get("code") == "E0456"


@dataclasses.dataclass
class Reading:
    """A value that was told to be good, and since when it is claimed to have been so."""

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
        # Wall clock less our clock, as it was found at several times.
        self.offsets = [time.time() - time.monotonic()]

    def begin(self, claim):
        """A command goes out."""
        with self._lock:
            claim.number = next(self._numbers)
            self.claims.append(claim)
        return claim

    def mark_clock(self):
        """Notes how the two clocks stand."""
        self.offsets.append(time.time() - time.monotonic())

    def mono(self, text):
        """The window of our clock in which a time of the wall clock lies."""
        wall = wall_time(text) if isinstance(text, str) else text
        return wall - max(self.offsets), wall - min(self.offsets) + 0.001


def wall_time(text):
    """Seconds since 1970 of RFC 3339."""
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def take_answer(claim, status, answer):
    """Lays what was answered into the claim."""
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
    """What is judged of an answer."""
    kept = {key: answer[key] for key in KEPT if answer.get(key) is not None}
    if "reason" in kept:
        kept["reason"] = str(kept["reason"])[:80]
    return kept

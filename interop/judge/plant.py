"""A site to be judged: lines of all families, the daemon, and the checks at the end."""

import os
import tempfile
import time

import daemon as program
from claims import Book
from judge import Judge
from line import Line
from modules import EdaAscii, EdaLc02, EdaRtu, Emd, Erc8, R55, World

# How soon after the last fault a line must work again.
BACK_MAX = 12.0
# A sample may be as old as a good value, one of all points older; and this much newer.
HISTORY_BEFORE, HISTORY_AFTER = 3.2, 0.65


def whole_site(world):
    """All families in all protocols, on six lines, since the lines limit the number of commands."""
    pulsing = EdaRtu(world, "gate", 3)
    pulsing.pulse_mask, pulsing.width = 0b1000, 0.5
    return {
        "rtu": [Erc8(world, "oven", 1), Emd(world, "tank", 2), pulsing],
        "ascii": [EdaAscii(world, "pump", 1, 4), EdaAscii(world, "old", 2, 4, is_old=True)],
        "lc02": [EdaLc02(world, "hall", 5, 8), EdaLc02(world, "shed", 6, 4)],
        "mixed": [R55(world, "yard", 9), EdaAscii(world, "door", 4, 8, checksum=False),
                  Erc8(world, "roof", 7)],
        "boards": [R55(world, "quay", 1), R55(world, "dock", 2)],
        "far": [Erc8(world, "mill", 1), EdaRtu(world, "barn", 2), EdaLc02(world, "well", 3, 8)],
    }


class Plant:
    """Lines of modules in a folder, and a daemon."""

    def __init__(self, seed, lines, groups=(), scenes=(), poll="250ms", pulsing=None):
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-judge-")
        self.world, self.book = World(), Book()
        self.lines = [
            Line(self.world, name, os.path.join(self.folder.name, name), modules, f"{seed}/{name}")
            for name, modules in lines(self.world).items()
        ]
        self.modules = [module for line in self.lines for module in line.modules]
        self.by_name = {module.name: module for module in self.modules}
        self.line_of = {module.name: line for line in self.lines for module in line.modules}
        self.world_labels = {module.name: module.labels for module in self.modules}
        self.groups, self.scenes, self.pulsing = list(groups), list(scenes), dict(pulsing or {})
        boards = [module for module in self.modules if module.model == "r55"]
        self.boards = [relay for module in boards for relay in module.labels]
        self.timed = [relay for module in self.modules for relay in module.labels
                      if relay not in self.pulsing and module.name != "old"]
        self.text = program.config(self.lines, self.groups, self.scenes, poll)
        self.daemon = program.Daemon(self.folder.name, self.text)
        self.back = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.daemon.close()
        for line in self.lines:
            line.close()
        self.folder.cleanup()

    def outputs(self):
        """All outputs."""
        return [relay for module in self.modules for relay in module.labels]

    def start(self):
        """Starts the daemon, and waits until all modules have answered."""
        self.daemon.start()
        return self.wait_back()

    def heal(self):
        """Ends all faults."""
        for line in self.lines:
            line.heal()

    def settled(self):
        """Brings the log up to date."""
        for line in self.lines:
            line.do(lambda now: None)
        return time.monotonic()

    def wait_back(self, limit=BACK_MAX):
        """Waits until every module is read; returns those that are not."""
        began, missing = time.monotonic(), ["nobody answers"]
        while time.monotonic() - began < limit:
            try:
                status, answer = self.daemon.ask("GET", "/points")
            except OSError:
                time.sleep(0.05)
                continue
            bad = {p["module"] for p in answer["points"] if p["quality"] != "good"}
            missing = sorted(bad) if status == 200 else missing
            if not missing:
                break
            time.sleep(0.1)
        self.back.append((time.monotonic(), missing))
        return not missing

    def wait_ended(self, limit):
        """Waits until no output is in a pulse or lease; returns those that still are."""
        began = time.monotonic()
        while True:
            _, answer = self.daemon.ask("GET", "/points")
            held = [point["path"] for point in answer["points"]
                    if point.get("pulse_until") or point.get("lease")]
            if not held or time.monotonic() - began > limit:
                return held
            time.sleep(0.1)

    def judged(self):
        """A judge of the claims so far."""
        self.settled()
        names = {name: line.name for name, line in self.line_of.items()}
        judge = Judge(self.world, self.book, self.daemon.lives, self.pulsing, names)
        judge.over = time.monotonic()
        return judge

    def judge_rest(self, judge):
        """Checks that the lines came back, the audit log, and the history."""
        for when, missing in self.back:
            judge.told("back", not missing, ",".join(missing), when, "not heard again in time")
        self._audit(judge)
        self._history(judge)

    def _audit(self, judge):
        """The log agrees with the answers, and its chain verifies."""
        entries, cursor = {}, ""
        while cursor is not None:
            tail = f"&cursor={cursor}" if cursor else ""
            status, page = self.daemon.ask("GET", f"/audit?limit=500{tail}")
            if status != 200:
                judge.told("audit", False, "", 0.0, f"{status} {page}")
                return
            entries |= {item["id"]: item for item in page["items"]}
            cursor = page.get("next")
        _, verified = self.daemon.ask("GET", "/audit/verify")
        judge.told("audit", verified.get("ok"), "", 0.0, f"the chain is broken: {verified}")
        for entry in entries.values():
            good = entry.get("end") is not None
            judge.told("open entry", good, entry["module"], 0.0, str(entry))
        for claim in self.book.claims:
            for part in claim.parts:
                if not part.told.get("audit") or not claim.answered:
                    continue
                entry = entries.get(part.told["audit"], {})
                if claim.is_done(part):
                    good = entry.get("end") == part.told["confirmed"]
                else:
                    good = bool(entry.get("end"))
                judge.told("audit", good, part.relay, claim.until,
                           lambda claim=claim, entry=entry: f"{claim.words()}\n  {entry}")

    def _history(self, judge):
        """Each good sample was true."""
        since = wall_ms(self.book, judge.over - 3600)
        paths = list(judge.world.changes)
        for path in paths:
            _, answer = self.daemon.ask("GET", f"/history?point={path}&from={since}&buckets=4000")
            if not (answer or {}).get("raw"):
                continue
            for sample in answer["samples"]:
                if sample["q"] != "good" or sample["v"] is None:
                    continue
                lo, hi = self.book.mono(sample["t"] / 1000)
                value = bool(sample["v"])
                good = judge.held(path, lo - HISTORY_BEFORE, hi + HISTORY_AFTER, value)
                judge.told("history", good, path, hi, f"{sample} at {hi:.3f}")


def wall_ms(book, when):
    """Our clock as milliseconds since 1970."""
    return int((when + book.offsets[-1]) * 1000)

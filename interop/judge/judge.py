"""Compares what was reported with what was true. Knows claims, windows and the log of the relays,
and nothing of the program or of the protocols."""

import bisect
import collections

from claims import is_undone

# How much later than due a pulse or lease may end while nothing is wrong with its line. The time of
# faults, and time without a daemon, is added.
END_MAX = 4.0
# How much later than due the command that ends it may still arrive: if it or its reply was lost, it
# is retried after one, two and four seconds, and each attempt takes its time.
TRIED_AGAIN = 12.0
# How much earlier than reported a timed end may come, because of rounding.
EARLY = 0.012
# After this time a command has ended: five seconds to be sent, and as many to be read back.
UNANSWERED_MAX = 10.0
# How old a value may be that a command reports as the state before it.
BEFORE_MAX = 2.5
# How long nothing is guaranteed for a line after a reply that this machine itself sent too late, or
# after another master has read it.
OVERDUE = 6.0
# How long after an answer a command may still reach a module: what is still in the terminal.
IN_FLIGHT = 0.02

# Everything that is judged: its name, and what it claims.
KINDS = {
    "readback": "what was read back was so",
    "reply": "an order came and was answered",
    "reply value": "a value that was acknowledged was not contradicted by a reading",
    "before": "what an output was before",
    "nobody's": "each order was somebody's, in time; nothing was done where that was told",
    "twice": "a toggle or a pulse of the module acted once, also where its key was sent again",
    "undone": "what was undone was so",
    "reading": "a good value was so, for its age",
    "end": "a pulse or a lease ended when it should",
    "left": "an output is in the end as its last commands wanted it",
    "held": "nothing is in a pulse or a lease at the end",
    "audit": "the log says what was answered",
    "open entry": "no entry without an end",
    "history": "a value in the history was so",
    "back": "a line works again when nothing is wrong any more",
}

# Those that depend on a reply that came in time.
OF_VALUES = ("readback", "reply", "reply value", "before", "reading", "history")

False_ = collections.namedtuple("False_", "kind relay when words")


class Judge:
    """The judge of one run. `lives` are those of the daemon; `jogs` are outputs that switch back
    by themselves."""

    def __init__(self, world, book, lives, pulsing=(), line_of=None):
        self.world, self.book, self.lives = world, book, lives
        self.pulsing, self.line_of = set(pulsing), line_of or {}
        self.checked, self.outside = collections.Counter(), collections.Counter()
        self.false = []
        # When the run was over: what is due later is not judged.
        self.over = float("inf")
        self._by_relay = collections.defaultdict(list)
        for claim in book.claims:
            if not claim.answered:
                claim.until = self._given_up(claim)
            for part in claim.parts:
                self._by_relay[part.relay].append((claim, part))
        for claims in self._by_relay.values():
            claims.sort(key=lambda both: both[0].since)
        self._begins = {relay: [claim.since for claim, _ in claims]
                        for relay, claims in self._by_relay.items()}
        self._longest = max((claim.until - claim.since for claim in book.claims), default=0.0)
        self._bad, self._clusters = {}, {}
        self._times = {relay: [change[0] for change in changes]
                       for relay, changes in world.changes.items()}

    def _given_up(self, claim):
        """How long a command may still act if its client got no answer: for the rest of the
        daemon's life, which finishes in order what it has begun, or for as long as a command
        takes at most."""
        at_most = claim.until + UNANSWERED_MAX
        ends = [life[2] for life in self.lives if life[0] <= claim.until and life[2]]
        return max(claim.until, min([at_most, *(end for end in ends if end >= claim.since)]))

    def _near(self, relay, since, until):
        """The commands for a relay whose windows may touch this one."""
        begins = self._begins.get(relay, [])
        first = bisect.bisect_left(begins, since - self._longest)
        return self._by_relay[relay][first:bisect.bisect_right(begins, until)]

    # What was true -------------------------------------------------------------------------

    def value_at(self, relay, when):
        """The state of a relay at that time."""
        at = bisect.bisect_right(self._times.get(relay, []), when) - 1
        return self.world.changes[relay][at][1] if at >= 0 else None

    def held(self, relay, since, until, value):
        """Whether it had this value at any moment of a window."""
        if self.value_at(relay, since) == value:
            return True
        times, changes = self._times.get(relay, []), self.world.changes[relay]
        first = bisect.bisect_right(times, since)
        last = bisect.bisect_right(times, until)
        return any(change[1] == value for change in changes[first:last])

    def orders(self, relay, since, until, value=None):
        """The commands that may have arrived in a window."""
        return [act for act in self.world.acts.get(relay, [])
                if act.hi >= since and act.lo <= until and value in (None, act.value)]

    def is_troubled(self, relay, since, until):
        """Whether there was a fault of the relay, its module or its line in this window."""
        module = relay.split(".")[0]
        stretches = [stretch for what in (relay, module, self.line_of.get(module))
                     for stretch in self.world.troubles.get(what, [])]
        return any(a <= until and (b is None or b >= since) for a, b in stretches)

    def calm_after(self, relay, since, length):
        """When this much time has passed since then without faults and with the daemon running."""
        end = since + length
        if relay not in self._bad:
            self._bad[relay] = self._bad_times(relay)
        for a, b in self._bad[relay]:
            if a <= end and b >= since:
                end = max(end, b + length)
        return end

    def _bad_times(self, relay):
        """The times of faults of a relay or on its way, and the times without a daemon."""
        module = relay.split(".")[0]
        bad = [stretch for what in (relay, module, self.line_of.get(module))
               for stretch in self.world.troubles.get(what, [])]
        bad += self.world.stalls.get(self.line_of.get(module), [])
        bad = [[a, float("inf") if b is None else b] for a, b in bad]
        for before, after in zip(self.lives, [*self.lives[1:], None], strict=True):
            if before[1] is not None:
                bad.append([before[1], after[0] + 1.5 if after else float("inf")])
        return sorted(bad)

    def is_outside(self, relay, when):
        """Whether this machine broke the timing that the judge guarantees to the daemon."""
        line = self.line_of.get(relay.split(".")[0])
        return any(late <= when <= late + OVERDUE for late in self.world.overdue.get(line, []))

    def told(self, kind, good, relay, when, words):
        """One check. `words` describe a false claim, or are a function that does."""
        if not good and kind in OF_VALUES and self.is_outside(relay, when):
            self.outside[kind] += 1
            return
        self.checked[kind] += 1
        if not good:
            self.false.append(False_(kind, relay, when, words() if callable(words) else words))

    # Claims --------------------------------------------------------------------------------

    def judge(self):
        """Judges all claims."""
        first, began = {}, {}
        for claim in self.book.claims:
            # A key that was sent without getting an answer may have been received: the next answer
            # is for that.
            since = began.setdefault(claim.key, claim.since) if claim.key else claim.since
            if not claim.answered:
                continue
            if claim.key and claim.key in first:
                # A repeated key: the answer is the first one, with the same content.
                same = claim.parts[0].told == first[claim.key].parts[0].told
                both = (claim, first[claim.key])
                self.told("twice", same, claim.parts[0].relay, claim.until,
                          lambda both=both: "\n  ".join(one.words() for one in both))
                continue
            if claim.key:
                first[claim.key] = claim
            for part in claim.parts:
                self._confirmed(claim, part, since)
        for relay in self.world.acts:
            self._orders(relay)
            self._twice(relay)
            self._ends(relay)
        for reading in self.book.readings:
            if reading.path in self._times:
                good = self.held(reading.path, reading.since, reading.until, reading.value)
                self.told("reading", good, reading.path, reading.until, reading.__str__)
        return self

    def _confirmed(self, claim, part, since):
        relay, told = part.relay, part.told
        if told.get("before") is not None and not told.get("renewed"):
            # The state before its own command, if it is certain which one that is: others may
            # command in the meantime, a pulse or a lease may end, and its own command may be lost.
            alone = not any(other is not claim and other.until >= since
                            for other, _ in self._near(relay, since, claim.until))
            acts = self.orders(relay, since, claim.until)
            until = acts[0].hi - 1e-6 if len(acts) == 1 and alone else claim.until
            good = self.held(relay, since - BEFORE_MAX, until, told["before"])
            self.told("before", good, relay, claim.until, claim.words)
        if claim.undone and is_undone(part):
            self._undone(claim, part)
        if not claim.is_done(part):
            return
        value = told.get("value")
        if told["confirmed"] == "readback" and value is not None:
            good = self.held(relay, since, claim.until, value)
            self.told("readback", good, relay, claim.until, claim.words)
        if told["confirmed"] == "reply":
            want = value if part.want is None else part.want
            acts = self.orders(relay, since, claim.until, None if part.want is None else want)
            acts = [act for act in acts if act.answered]
            # A pulse output ignores such a command, and answers it.
            good = bool(acts) or relay in self.pulsing and not want
            self.told("reply", good, relay, claim.until, claim.words)
            if claim.verify and acts and value is not None and relay not in self.pulsing:
                good = not all(self._is_contradicted(act, relay, value, claim) for act in acts)
                self.told("reply value", good, relay, claim.until, claim.words)

    def _is_contradicted(self, act, relay, value, claim):
        """Whether one of the two readings after a command reported the other state."""
        if self.held(relay, act.hi, claim.until, value):
            return False
        replies = self.world.replies.get(relay.split(".")[0], [])
        # In the order in which they were sent.
        first = bisect.bisect_left(replies, act.hi, key=lambda reply: reply.sent)
        last = bisect.bisect_right(replies, claim.until, key=lambda reply: reply.sent)
        after = [reply for reply in replies[first:last] if reply.lo >= act.hi]
        return any(reply.clean and reply.states.get(relay, value) != value for reply in after[:2])

    def _undone(self, claim, part):
        relay = part.relay
        others = [other for other, _ in self._by_relay[relay] if other is not claim
                  and other.since <= claim.until and claim.since
                  <= other.until + (other.seconds + END_MAX if other.seconds else 0)]
        if others or relay in self.pulsing or self.is_troubled(relay, claim.since, claim.until):
            return
        before, after = self.value_at(relay, claim.since), self.value_at(relay, claim.until)
        self.told("undone", before == after, relay, claim.until, claim.words)

    # Commands ------------------------------------------------------------------------------

    def _orders(self, relay):
        """Each command that arrived belongs to a request."""
        claims, begins = self._by_relay[relay], self._begins.get(relay, [])
        for act in self.world.acts[relay]:
            # Newest first: it is nearly always one of those.
            before = reversed(claims[:bisect.bisect_right(begins, act.hi)])
            good = any(self._may_order(act, claim, part) for claim, part in before)
            self.told("nobody's", good, relay, act.hi, lambda act=act: "\n  ".join(
                [f"{act} came, and nobody ordered it then", *self._last_words(relay, act.hi, 6)]))

    def _last_words(self, relay, when, count):
        """The last requests for a relay before that."""
        before = [claim for claim, _ in self._by_relay[relay] if claim.since <= when]
        return [claim.words() for claim in before[-count:]]

    def _may_order(self, act, claim, part):
        """Whether a command may come from this request, or from its end."""
        if claim.since > act.hi or claim.did_nothing(part):
            return False
        until = claim.until + IN_FLIGHT
        if claim.kind == "unlease" and part.told.get("confirmed") == "reply":
            # An end that was acknowledged but not seen is not trusted, and retried.
            until = self.calm_after(part.relay, claim.until, TRIED_AGAIN)
            return act.kind == "set" and act.lo <= until and act.value == part.told.get("value")
        if act.kind != "set":
            # Toggles and the module's own pulses only come from requests for them.
            fits = claim.kind == "jog" or claim.by in ("device",) or claim.is_raw
            fits = fits or part.relay in self.pulsing
            return fits and act.lo <= until
        if act.lo <= until:
            either = part.want is None or claim.all_or_nothing or claim.kind in ("pulse", "lease")
            if either and self._is_ending(act, claim, part) is not False:
                return True
            if part.want == act.value:
                return True
        return self._is_ending(act, claim, part) is True

    def _is_ending(self, act, claim, part):
        """Whether this is the end of what the request began; None: it has no end."""
        if claim.by != "host" or part.want == act.value:
            return None
        if not claim.is_done_or_renewed(part):
            # What may have begun is ended in any case, at once or later.
            return act.lo <= self.calm_after(part.relay, claim.until + claim.seconds, TRIED_AGAIN)
        due = claim.until + claim.seconds
        if any(life[3] == "TERM" and claim.since <= life[1] <= act.hi for life in self.lives):
            # A daemon that is stopped ends at once what it has begun, or after its next start.
            return act.lo <= self.calm_after(part.relay, due, TRIED_AGAIN)
        if act.hi < claim.since + claim.seconds - EARLY:
            return False
        if claim.kind == "lease" and self._is_leased(act, claim, part):
            return False
        return act.lo <= self.calm_after(part.relay, due, TRIED_AGAIN)

    def _is_leased(self, act, claim, part):
        """Whether the lease still holds, by its last renewal; of several at once by all of them."""
        same = [other for other, own in self._by_relay[part.relay]
                if other.kind == "lease" and own.want == part.want and other.until < act.lo
                and other.since >= claim.since and other.is_done_or_renewed(own)]
        newest = max((other.since for other in same), default=0.0)
        last = [other for other in same if other.until >= newest]
        return bool(last) and all(o.since + o.seconds - EARLY > act.hi for o in last)

    def _twice(self, relay):
        """Each toggle and each pulse of the module has a request of its own."""
        acts = [act for act in self.world.acts[relay] if act.kind != "set"]
        if not acts:
            return
        claims, keys = [], {}
        for claim, part in self._by_relay[relay]:
            wants = claim.is_raw or claim.by == "device" or relay in self.pulsing
            if not wants or claim.did_nothing(part):
                continue
            first = keys.get(claim.key) if claim.key else None
            if first is not None:
                claims[first][1] = max(claims[first][1], claim.until + IN_FLIGHT)
                continue
            if claim.key:
                keys[claim.key] = len(claims)
            claims.append([claim.since, claim.until + IN_FLIGHT])
        for act in sorted(acts, key=lambda act: act.hi):
            fits = [c for c in claims if c[0] <= act.hi and c[1] >= act.lo]
            if fits:
                claims.remove(min(fits, key=lambda c: c[1]))
            self.told("twice", bool(fits), relay, act.hi,
                      lambda act=act: f"{act} is one more than was ordered")

    # Ends ----------------------------------------------------------------------------------

    def _ends(self, relay):
        claims = [] if relay in self.pulsing else self._by_relay[relay]
        for claim, part in claims:
            if claim.by != "host" or not claim.is_done_or_renewed(part):
                continue
            due = claim.until + claim.seconds
            until = self.calm_after(relay, due, END_MAX)
            others = [other for other, own in self._near(relay, claim.since, until)
                      if other is not claim and other.until >= claim.since
                      and not other.did_nothing(own)]
            if claim.kind == "lease":
                # The last renewal counts.
                others = [other for other in others if other.since > claim.since
                          or other.kind != "lease" or other.parts[0].want != part.want]
            if others or until > self.over:
                continue
            good = self.held(relay, due - EARLY, until, not part.want)
            self.told("end", good, relay, until,
                      lambda claim=claim, due=due: f"{claim.words()}, due {due:.3f}")

    # The end of a run ----------------------------------------------------------------------

    def candidates(self, relay, until):
        """The states that an output may have according to the answers, and since when."""
        may, since = {self.value_at(relay, 0.0)}, 0.0
        clusters = self._clusters_of(relay)
        last = bisect.bisect_right(clusters, until, key=lambda cluster: cluster[0][0].since)
        clusters = [[both for both in cluster if both[0].since <= until]
                    for cluster in clusters[:last]]
        # What was before the last certain one does not matter.
        first = next((nth for nth in reversed(range(last)) if self._decides(clusters[nth])), 0)
        for cluster in clusters[first:]:
            new = set()
            for claim, part in cluster:
                if not claim.did_nothing(part):
                    # What is undone is as it was before the batch came to it.
                    new |= may if is_undone(part) else self._final(claim, part)
            is_done = any(self._is_sure(claim, part) for claim, part in cluster)
            may = new if is_done else new | may
            since = cluster[0][0].since if is_done else since
        return may, since

    def _clusters_of(self, relay):
        """The commands for a relay, concurrent ones grouped."""
        if relay not in self._clusters:
            clusters, ends = [], float("-inf")
            for claim, part in self._by_relay[relay]:
                if claim.since > ends:
                    clusters.append([])
                clusters[-1].append((claim, part))
                ends = max(ends, claim.until)
            self._clusters[relay] = clusters
        return self._clusters[relay]

    @staticmethod
    def _is_sure(claim, part):
        """Whether an output certainly has the state that the command set, or that a concurrent
        one did."""
        sure = claim.is_done(part) and part.told["confirmed"] != "sent"
        return sure and not claim.did_nothing(part) and not part.told.get("renewed")

    def _decides(self, cluster):
        """Whether these commands alone determine the state that the output may have after them."""
        return (any(self._is_sure(claim, part) for claim, part in cluster)
                and not any(is_undone(part) for _, part in cluster))

    def _final(self, claim, part):
        told = part.told
        if part.relay in self.pulsing:
            return {False}
        if claim.kind in ("pulse", "lease", "jog"):
            if told.get("renewed") or claim.is_done(part) or claim.by == "host":
                return {not part.want}
            return {part.want, not part.want}
        if part.want is not None:
            return {part.want}
        value = told.get("value")
        return {value} if claim.is_done(part) and value is not None else {False, True}

    def left(self, now):
        """With everything idle, each output has the state that its last commands set."""
        for relay in self._by_relay:
            if relay not in self._times:
                continue
            may, since = self.candidates(relay, now)
            # The state of a relay with faults of its own follows from no command.
            if self.is_troubled(relay, since - 1.0, now):
                continue
            value = self.value_at(relay, now)
            self.told("left", value in may, relay, now,
                      lambda value=value, may=may, relay=relay: "\n  ".join(
                          [f"is {value}, and may be {sorted(may)}",
                           *self._last_words(relay, now, 8)]))

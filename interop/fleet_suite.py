"""A fleet's NATS servers, as `railbus fleet init` makes them, tried by nats-py: a site reaches what
is its own, and with its key nobody reaches anything else."""

import asyncio
import json
import ssl
import time

import nats
import nkeys
from nats.js.errors import APIError

from fleet import (
    Fleet, asked, claims_of, flushed, forbidden, inside, railbus, signed, unsigned, write_creds)
from modbus_tcp import PATIENCE
from rig import Tally

OWN, OTHER = "plant1", "plant2"
# What no site may name for anything: subjects of another site, of the centre and of the servers.
FOREIGN = (
    *(f"rb.up.{OTHER}.{kind}" for kind in ("hello", "beat", "data", "event", "state", "live")),
    *(f"rb.down.{OTHER}.s.{kind}" for kind in ("cmd", "api", "watch", "resend")),
    f"rb.down.{OWN}.s.cmd", f"rb.desired.{OTHER}.config", f"rb.desired.{OWN}.config",
    f"rb.cmd.{OTHER}.1", f"rb.cmd.{OWN}.1", "rb.audit", f"rb.fleet.lease.{OTHER}",
    f"rb.fleet.lease.{OWN}", "rb.fleet.site.x", "rb.fleet.user.x", "rb.fleet.layer.x",
    "rb.fleet.group.x", "rb.fleet.rollout.x", "rb.fleet.alarm.x",
    f"_INBOX.{OTHER}.x", "_INBOX.hub.x", f"rb.up.{OWN}", f"rb.up.{OWN}.data.x", "rb.up",
    f"$JS.API.DIRECT.GET.DESIRED.rb.desired.{OTHER}.config",
    "$JS.API.DIRECT.GET.DESIRED", "$JS.API.DIRECT.GET.DATA",
    f"$JS.API.DIRECT.GET.DATA.rb.up.{OWN}.data", "$JS.API.INFO", "$JS.API.STREAM.NAMES",
    "$JS.API.STREAM.LIST", "$JS.API.CONSUMER.DURABLE.CREATE.DATA.x",
    "$JS.API.CONSUMER.CREATE.DATA", "$JS.API.CONSUMER.CREATE.DATA.x.rb.up.>",
    "$JS.API.CONSUMER.MSG.NEXT.DATA.archive", "$JS.API.CONSUMER.LEADER.STEPDOWN.DATA.archive",
    *(f"$JS.API.{group}.{what}.{stream}" for group, what in (
        ("STREAM", "INFO"), ("STREAM", "CREATE"), ("STREAM", "UPDATE"), ("STREAM", "DELETE"),
        ("STREAM", "PURGE"), ("STREAM", "MSG.GET"), ("STREAM", "MSG.DELETE"),
        ("STREAM", "SNAPSHOT"), ("STREAM", "RESTORE"), ("STREAM", "LEADER.STEPDOWN"),
        ("CONSUMER", "NAMES"), ("CONSUMER", "LIST")) for stream in ("DATA", "AUDIT")),
    "$JS.ACK.DATA.archive.1.1.1.1.1", "$JS.FC.DATA.x", "$SYS.REQ.SERVER.PING",
    "$SYS.REQ.CLAIMS.UPDATE", "$SYS.REQ.CLAIMS.LIST", "$SYS.REQ.CLAIMS.DELETE",
    "$SYS.REQ.ACCOUNT.PING.CONNZ", "_R_.x.y", "_GR_.x", "plant", ">",
)
# What no site may listen to, besides.
PATTERNS = (
    ">", "*", "rb.>", "rb.*.>", "rb.up.>", f"rb.up.{OWN}.data", "rb.up.*.data", "rb.down.>",
    "rb.down.*.*.cmd", f"rb.down.{OTHER}.>", "rb.desired.>", "rb.desired.*.*",
    f"rb.desired.{OTHER}.*", "_INBOX.>", "_INBOX.*.>", f"_INBOX.{OTHER}.>", "_INBOX.hub.>",
    "rb.cmd.>", "rb.fleet.>", "rb.audit", "$JS.>", "$JS.EVENT.>", "$JS.API.>", "$JS.ACK.>",
    "$SYS.>", "$SYS.ACCOUNT.*.CONNECT", "_R_.>", "_GR_.>",
)
# Where a site may name a subject for the answer, which no server checks.
ASKED = (f"rb.up.{OWN}.data", f"rb.up.{OWN}.event", f"rb.up.{OWN}.state",
         f"$JS.API.DIRECT.GET.DESIRED.rb.desired.{OWN}.config")
# What a message to a stream can have with it that does more than come into it.
HEADERS = (
    {"Nats-Rollup": "all"}, {"Nats-Rollup": "sub"}, {"Nats-TTL": "1s"}, {"Nats-Incr": "1"},
    {"Nats-Expected-Last-Sequence": "0"}, {"Nats-Expected-Stream": "AUDIT"},
    {"Nats-Schedule": "@every 1s", "Nats-Schedule-Target": "rb.audit"},
    {"Nats-Batch-Id": "x", "Nats-Batch-Sequence": "1", "Nats-Batch-Commit": "1"},
)


class Plant:
    """The centre, two sites, and a tally."""

    def __init__(self, fleet, tally):
        self.fleet, self.tally = fleet, tally
        self.at_hub = []

    async def start(self):
        """All connect; the centre hears all that is said to it."""
        self.hub = await self.fleet.centre()
        self.own, self.other = await self.fleet.site(OWN), await self.fleet.site(OTHER)

        async def note(message):
            self.at_hub.append((message.subject, message.data))

        await self.hub.subscribe("rb.up.*.*", cb=note)
        await flushed(self.hub)

    async def said(self, data):
        """Whether the centre hears this of the other site, and so everything before it."""
        await self.other.publish(f"rb.up.{OTHER}.beat", data)
        await flushed(self.other)
        deadline = time.monotonic() + PATIENCE
        while (f"rb.up.{OTHER}.beat", data) not in self.at_hub:
            if time.monotonic() > deadline:
                return False
            await asyncio.sleep(0.01)
        return True

    async def counts(self):
        """How many messages each subject of each stream has."""
        found = {}
        streams = self.hub.jetstream(timeout=PATIENCE)
        for name in ("DATA", "EVENT", "STATE", "DESIRED", "LEDGER", "FLEET", "AUDIT"):
            info = await streams.stream_info(name, subjects_filter=">")
            for subject, count in (info.state.subjects or {}).items():
                found[subject] = count
        return found

    def check(self, *words):
        """One check."""
        self.tally.check(*words)


async def own_ways(s):
    """What a site may do comes through, and is answered."""
    entry = "a site reaches the centre"
    for kind in ("data", "event", "state"):
        subject = f"rb.up.{OWN}.{kind}"
        answer = await s.own.request(subject, b"1", timeout=PATIENCE,
                                     headers={"Nats-Msg-Id": f"{OWN}-{kind}-1"})
        s.check(entry, json.loads(answer.data).get("stream"), kind.upper(), subject)
        again = await s.own.request(subject, b"1", timeout=PATIENCE,
                                    headers={"Nats-Msg-Id": f"{OWN}-{kind}-1"})
        s.check(entry, json.loads(again.data).get("duplicate"), True, f"{subject} again")
    for kind in ("hello", "beat", "live"):
        await s.own.publish(f"rb.up.{OWN}.{kind}", b"x")
    # Another connection: what this one said has been passed on by then.
    await flushed(s.own)
    s.check(entry, await s.said(b"1"), True, "a beat")
    for kind in ("hello", "beat", "live", "data"):
        subject = f"rb.up.{OWN}.{kind}"
        s.check(entry, subject in [subject for subject, _ in s.at_hub], True, subject)

    entry = "the centre reaches a site"

    async def answer(message):
        await message.respond(b"done " + message.data)

    await s.own.subscribe(f"rb.down.{OWN}.*.*", cb=answer)
    await flushed(s.own)
    for kind in ("cmd", "api", "watch", "resend"):
        got = await asked(s.hub, f"rb.down.{OWN}.s1.{kind}", kind.encode())
        s.check(entry, got.data, b"done " + kind.encode(), kind)
    try:
        await s.hub.request(f"rb.down.{OTHER}.s1.cmd", b"", timeout=PATIENCE)
        got = "an answer"
    except nats.errors.NoRespondersError:
        got = "nobody there"
    s.check(entry, got, "nobody there", "a site that does not listen")

    entry = "a site reads its documents"
    streams = s.hub.jetstream(timeout=PATIENCE)
    came = asyncio.Queue()
    await s.own.subscribe(f"rb.desired.{OWN}.*", cb=came.put)
    await flushed(s.own)
    for site in (OWN, OTHER):
        await streams.publish(f"rb.desired.{site}.config", f"of {site}".encode())
    pushed = await asyncio.wait_for(came.get(), PATIENCE)
    s.check(entry, (pushed.subject, pushed.data),
            (f"rb.desired.{OWN}.config", f"of {OWN}".encode()), "as it comes")
    for client, site in ((s.own, OWN), (s.other, OTHER)):
        subject = f"$JS.API.DIRECT.GET.DESIRED.rb.desired.{site}.config"
        got = await client.request(subject, b"", timeout=PATIENCE)
        s.check(entry, got.data, f"of {site}".encode(), f"{site} as it is")
    subject = f"$JS.API.DIRECT.GET.DESIRED.rb.desired.{OWN}.none"
    got = await s.own.request(subject, b"", timeout=PATIENCE)
    s.check(entry, got.headers.get("Status"), "404", "one that is not there")
    s.check(entry, s.own.said + s.other.said, [], "what the servers complain of")


async def foreign_ways(s):
    """Whatever else a site publishes or listens to is forbidden."""
    before = await s.counts()
    for subject in FOREIGN:
        said = await forbidden(
            s.own, lambda subject=subject: s.own.publish(subject, b"stolen"), subject)
        s.check("a site publishes nowhere else", said, 1, subject)
    for subject in {*FOREIGN, *PATTERNS} - {f"rb.down.{OWN}.s.cmd", f"rb.desired.{OWN}.config"}:
        for group in ("", "hub"):
            said = await forbidden(
                s.own, lambda subject=subject, group=group: s.own.subscribe(subject, group),
                subject)
            s.check("a site hears nothing else", said, 1, f"{subject}, group {group!r}")
    s.check("a site publishes nowhere else", await s.said(b"2"), True, "a beat of the other")
    stolen = [subject for subject, data in s.at_hub if data == b"stolen"]
    s.check("a site publishes nowhere else", stolen, [], "heard by the centre")
    s.check("a site publishes nowhere else", await s.counts(), before, "in the streams")


async def answers_elsewhere(s):
    """A subject that a site names for an answer leads to no stream, and not to the centre."""
    entry = "an answer goes nowhere else"
    before, complaints = await s.counts(), len(s.own.said)
    sent = 0
    for via in ASKED:
        for subject in FOREIGN[:-1]:
            await s.own.publish(via, b"deputy", reply=subject)
            sent += via.endswith(".data")
    await flushed(s.own)
    # The last answer of each kind comes after all the others.
    for via in ASKED:
        await s.own.request(via, b"last", timeout=PATIENCE)
    s.check(entry, await s.said(b"3"), True, "a beat of the other")
    after = await s.counts()
    own = {f"rb.up.{OWN}.{kind}" for kind in ("data", "event", "state")}
    for subject in sorted({*before, *after, *FOREIGN} - own):
        s.check(entry, after.get(subject), before.get(subject), f"in the streams: {subject}")
    # Answers to the servers' own subjects are not even taken.
    refused = [text for text in s.own.said[complaints:] if "with reply" in text]
    s.check(entry, after[f"rb.up.{OWN}.data"] - before[f"rb.up.{OWN}.data"],
            sent + 1 - len(refused) // len(ASKED), f"its own came all; {refused}")
    wrong = {subject for subject, data in s.at_hub
             if not subject.startswith(f"rb.up.{OWN}.") and data not in (b"1", b"2", b"3")}
    s.check(entry, wrong, set(), "heard by the centre")


async def headers_do_nothing(s):
    """Headers of a site's message act on no other message."""
    entry = "headers reach nothing else"
    answer = await s.other.request(f"rb.up.{OTHER}.data", b"mine", timeout=PATIENCE)
    s.check(entry, json.loads(answer.data).get("stream"), "DATA", "the other's own")
    before = await s.counts()
    for headers in HEADERS:
        await s.own.request(f"rb.up.{OWN}.data", b"x", headers=headers, timeout=PATIENCE)
        after = await s.counts()
        its = f"rb.up.{OWN}.data"
        others = lambda counts, its=its: {key: n for key, n in counts.items() if key != its}
        s.check(entry, others(after), others(before), str(headers))
        s.check(entry, after[its] >= before[its], True, f"{headers}: none of its own is gone")
    streams = s.hub.jetstream(timeout=PATIENCE)
    last = await streams.get_last_msg("DATA", f"rb.up.{OTHER}.data")
    s.check(entry, last.data, b"mine", "the other's own is there")


async def keys(s):
    """Who gets in at all."""
    entry = "only keys of the fleet are accepted"
    folder = s.fleet.folder
    token, seed = inside(s.fleet.creds(OWN))
    signature = token.split(".")[2]
    claims = claims_of(token)
    site_seed = (folder / "hub/site-signing.nk").read_text(encoding="utf-8").strip()
    stranger = nkeys.encode_seed(b"\x07" * 32, nkeys.PREFIX_BYTE_ACCOUNT).decode()
    _, other_seed = inside(s.fleet.creds(OTHER))
    rights = {"pub": {"allow": [">"]}, "sub": {"allow": [">"]}, "subs": -1, "data": -1,
              "payload": -1}
    tries = {
        "as it is": (token, seed, True),
        "signed again by the key of sites": (signed(claims, site_seed), seed, True),
        "another name, and the signature of before":
            (f"{unsigned({**claims, 'name': OTHER})}.{signature}", seed, False),
        "signed by a stranger": (signed(claims, stranger), seed, False),
        "signed by a stranger, who says so":
            (signed({**claims, "iss": nkeys.from_seed(stranger.encode()).public_key.decode()},
                    stranger), seed, False),
        "the key of another": (token, other_seed, False),
        "expired": (signed({**claims, "exp": int(time.time()) - 60}, site_seed), seed, False),
        "signed by a clock that is ahead":
            (signed({**claims, "iat": int(time.time()) + 240}, site_seed), seed, True),
        "rights of its own":
            (signed({**claims, "nats": {**claims["nats"], **rights}}, site_seed), seed, False),
        "another account": (signed({**claims, "nats": {
            **claims["nats"], "issuer_account": "A" * 56}}, site_seed), seed, False),
    }
    for name, (token, seed, wanted) in tries.items():
        path = write_creds(folder / "try.creds", token, seed)
        try:
            client = await s.fleet.connect(path, f"_INBOX.{OWN}", max_reconnect_attempts=0)
            await flushed(client)
            got = client.is_connected
            await client.close()
        except (nats.errors.Error, OSError, asyncio.TimeoutError):
            got = False
        s.check(entry, got, wanted, name)
    for name, options in (("no key", {}), ("a password", {"user": "hub", "password": "hub"}),
                          ("another authority", {"tls": ssl.create_default_context()})):
        try:
            await s.fleet.connect(None, f"_INBOX.{OWN}", **options)
            got = True
        except (nats.errors.Error, OSError):
            got = False
        s.check(entry, got, False, name)


async def centre(s):
    """What the keys of the centre can't do."""
    entry = "what people did stays"
    streams = s.hub.jetstream(timeout=PATIENCE)
    await streams.publish("rb.audit", b"somebody did something")
    for subject in ("$JS.API.STREAM.DELETE.AUDIT", "$JS.API.STREAM.PURGE.AUDIT",
                    "$JS.API.STREAM.MSG.DELETE.AUDIT", "$JS.API.STREAM.UPDATE.AUDIT",
                    "$JS.API.STREAM.RESTORE.AUDIT", "$JS.API.STREAM.PEER.REMOVE.AUDIT",
                    f"rb.up.{OWN}.data"):
        said = await forbidden(
            s.hub, lambda subject=subject: s.hub.publish(subject, b'{"seq": 1}'), subject)
        s.check(entry, said, 1, subject)
    # Other streams may have other limits.
    info = await streams.stream_info("LEDGER")
    await streams.update_stream(info.config.evolve(max_msgs_per_subject=4))
    # What is created again has no other limits.
    with_limit = (await streams.stream_info("AUDIT")).config.evolve(max_msgs=1)
    try:
        await streams.add_stream(with_limit)
        got = "changed"
    except APIError:
        got = "refused"
    s.check(entry, got, "refused", "created with another limit")
    s.check(entry, (await s.counts()).get("rb.audit"), 1, "in the stream")
    entry = "the system key does what it is for"
    system = await s.fleet.connect(s.fleet.hub("system.creds"), "_INBOX.system")
    account = (s.fleet.folder / "hub/sites-account.pub").read_text(encoding="utf-8").strip()
    subject = f"$SYS.REQ.ACCOUNT.{account}.CLAIMS.LOOKUP"
    answer = await system.request(subject, b"", timeout=PATIENCE)
    s.check(entry, answer.data[:2], b"ey", "claims of an account")
    for subject in ("$SYS.REQ.CLAIMS.DELETE", "$SYS.REQ.SERVER.X.RELOAD", "rb.audit", "x"):
        said = await forbidden(
            system, lambda subject=subject: system.publish(subject, b""), subject)
        s.check(entry, said, 1, subject)


async def stolen(s):
    """Keys that are revoked are let in no longer, and others go on."""
    entry = "a revoked key is not accepted"
    folder = str(s.fleet.folder)

    async def gets_in(site, nth="", at=0):
        """Whether a server lets a key in; None if it can't be reached or says something else."""
        try:
            client = await s.fleet.connect(s.fleet.creds(site, nth), f"_INBOX.{site}", at,
                                           max_reconnect_attempts=0)
            await flushed(client)
            await client.close()
            return True
        except nats.errors.Error as error:
            return False if "authorization" in str(error).lower() else None
        except (OSError, asyncio.TimeoutError):
            return None

    async def becomes(what, want):
        deadline = time.monotonic() + PATIENCE
        while (so := await what()) != want and time.monotonic() < deadline:
            await asyncio.sleep(0.1)
        return so

    async def revoke(*words):
        return await asyncio.to_thread(railbus, "fleet", "revoke", folder, *words, "-o", "json")

    async def is_connected():
        return s.own.is_connected

    first = s.fleet.creds(OWN)
    key = claims_of(inside(first)[0])["sub"]
    s.check(entry, s.own.is_connected, True, "it is connected")
    code, said = await revoke(OWN)
    done = json.loads(said.splitlines()[0])
    s.check(entry, (code, done["keys"], sorted(done["servers"])),
            (0, [key], ["server1", "server2", "server3"]), f"railbus fleet revoke: {said}")
    s.check(entry, await becomes(is_connected, False), False, "its connection ends")
    for at in range(3):
        s.check(entry, await gets_in(OWN, at=at), False, f"at server{at + 1}")
    s.check(entry, await gets_in(OWN, "-again"), True, "another key of the same site")
    s.check(entry, await s.said(b"4"), True, "the other site goes on")
    # In the same second, and without a key: nothing is lost of what was there.
    code, said = await revoke()
    s.check(entry, (code, json.loads(said.splitlines()[0])["keys"]), (0, [key]), f"again: {said}")
    s.check(entry, (await gets_in(OWN), await gets_in(OWN, "-again")), (False, True),
            "no other key is revoked by that")
    seed = s.fleet.folder / "offline/operator-signing.nk"
    away = seed.rename(s.fleet.folder / "away.nk")
    code, said = await revoke(OTHER)
    s.check(entry, (code, "E0160" in said), (1, True), f"without the key of the operator: {said}")
    s.check(entry, await gets_in(OTHER), True, "nothing is revoked")
    away.rename(seed)
    # One of the servers is away.
    await asyncio.to_thread(s.fleet.kill, 2)
    code, said = await revoke(OTHER)
    s.check(entry, (code, "E1101" in said), (11, True), f"a server is away: {said}")
    s.fleet.start(2)
    back = lambda: gets_in(OWN, "-again", 2)
    s.check(entry, await becomes(back, True), True, "it is back")
    # The others once more: they must not take from it what it had.
    for at in (2, 0, 1, 2):
        out = lambda at=at: gets_in(OTHER, at=at)
        s.check(entry, await becomes(out, False), False, f"it hears of it: server{at + 1}")
    s.check(entry, (await gets_in(OWN), await gets_in(OWN, "-again")), (False, True),
            "what was revoked before")
    # Two at the same moment: both are revoked.
    others = [s.fleet.creds("plant3"), s.fleet.creds("plant4")]
    s.check(entry, [await gets_in(site) for site in ("plant3", "plant4")], [True, True], "both")
    ends = await asyncio.gather(revoke("plant3"), revoke("plant4"))
    s.check(entry, [code for code, _ in ends], [0, 0], f"two at a time: {ends} {others}")
    s.check(entry, [await gets_in(site) for site in ("plant3", "plant4")], [False, False],
            "neither undoes the other")
    code, said = await revoke("nowhere")
    s.check(entry, (code, "E0836" in said), (8, True), f"a site without keys: {said}")
    # Keys that were made elsewhere are named.
    notes = s.fleet.folder / f"hub/sites/{OWN}.keys"
    notes.unlink()
    code, said = await revoke(OWN)
    s.check(entry, (code, "--key" in said), (8, True), f"no key is noted: {said}")
    key = claims_of(inside(s.fleet.creds(OWN, "-again"))[0])["sub"]
    code, said = await revoke(OWN, "--key", key)
    s.check(entry, (code, await gets_in(OWN, "-again")), (0, False), f"one that is named: {said}")
    # A note that is broken is refused, and locks nobody out.
    notes.write_text(f"UTYPO 1\n{key} 1\n", encoding="utf-8")
    code, said = await revoke(OWN)
    s.check(entry, (code, "line 1" in said), (1, True), f"a broken note: {said}")
    code, said = await revoke()
    s.check(entry, code, 0, f"and all else goes on: {said}")


def suite():
    """Everything, at three servers."""
    tally = Tally("fleet")

    async def run(fleet):
        s = Plant(fleet, tally)
        await s.start()
        for part in (own_ways, foreign_ways, answers_elsewhere, headers_do_nothing, keys, centre,
                     stolen):
            await part(s)

    with Fleet() as fleet:
        asyncio.run(run(fleet))
    return tally


SUITES = [("fleet: who reaches what", suite)]

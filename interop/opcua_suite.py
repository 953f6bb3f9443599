"""The daemon's OPC UA server, with asyncua: what is read, watched and kept is true, what is written
has moved or is said not to have, and nobody is let in who should not be."""

import datetime
import os
import signal
import socket
import threading

from asyncua import ua

from modbus_tcp import HOST, until
from opcua import PASSWORD, POLICIES, Certificates, Plant

OFF = [0] * 8
GOOD, STALE = "Good", "UncertainLastUsableValue"
GONE, UNKNOWN = "BadNoCommunication", "BadNodeIdUnknown"
UNTRUSTED = "BadCertificateUntrusted"
# How the client of the suite is called, and one that nobody trusts.
CLIENT, STRANGER = "scada", "stranger"


def suite():
    """What a client on this machine sees and does."""
    with Plant(anonymous=True) as s:
        with s.session() as li:
            browsed(s, li)
            read(s, li)
            watched(s, li)
            stale(s, li)
            paused(s, li)
            written(s, li)
            called(s, li)
        rights(s)
        kept(s)
        many(s)
    return s.tally


def browsed(s, li):
    """The nodes, and what they are."""
    entry = "browse: lines, modules and points"
    at = lambda *names: ["0:Objects", *(f"{li.namespace}:{name}" for name in names)]
    root = li.client.nodes.root
    for names, want in ((("railbus", "main", "oven", "k1"), "oven.k1"),
                        (("railbus", "main", "tank", "ai1"), "tank.ai1"),
                        (("railbus", "main", "hall", "State"), "hall/State")):
        found = li.do(root.get_child(at(*names)))
        s.check(entry, found.nodeid.Identifier, want, "/".join(names))
    entry = "browse: types"
    for name, want in (("oven.k1", ua.ObjectIds.TwoStateDiscreteType),
                       ("hall.di0", ua.ObjectIds.TwoStateDiscreteType),
                       ("tank.ai1", ua.ObjectIds.AnalogUnitRangeType)):
        s.check(entry, li.do(li.node(name).read_type_definition()).Identifier, want, name)
    s.check(entry, li.read("oven.k1", ua.AttributeIds.DataType)[1].Identifier,
            ua.ObjectIds.Boolean, "data type")
    ends = li.read("tank.ai1/EURange")[1]
    s.check(entry, (ends.Low, ends.High), (0.0, 10.0), "EURange")
    s.check(entry, li.read("tank.ai1/EngineeringUnits")[1].UnitId, 5655636, "VLT")
    s.check(entry, li.read("oven/Model")[1], "erc8", "Model")
    s.check(entry, li.read("oven/Address")[1], 3, "Address")
    access = {name: li.read(name, ua.AttributeIds.AccessLevel)[1] & 2
              for name in ("oven.k1", "oven.k6", "hall.di0")}
    s.check(entry, access, {"oven.k1": 2, "oven.k6": 0, "hall.di0": 0}, "what can be written")


def read(s, li):
    """Values with their status and source time."""
    entry = "read: value, status and source time"
    for name, value in (("oven.k1", False), ("hall.di0", True), ("hall.di1", False),
                        ("tank.ai1", 8.71), ("oven/State", "online"),
                        ("line/main/State", "up")):
        s.reads(entry, li, name, (GOOD, value))
    first = li.read("oven.k1")[2]
    now = datetime.datetime.now(datetime.timezone.utc)
    s.check(entry, abs((now - first).total_seconds()) < 60, True, "of this minute")
    # It is polled, and the time is that of the newest reading.
    until(lambda: li.read("oven.k1")[2] > first)
    s.check(entry, li.read("oven.k1")[2] > first, True, "a newer reading")
    s.check(entry, li.read("oven.k9")[0], UNKNOWN, "no such point")
    status = li.read("oven.k1", ua.AttributeIds.Historizing)
    s.check(entry, status[:2], (GOOD, True), "it is kept")


def watched(s, li):
    """Changes, and modules that go: with and without a filter, and with all intervals."""
    ways = {"no filter": {}, "filter": {"filtered": True}, "interval 0": {"interval": 0.0},
            "interval 60 s": {"interval": 60000.0, "filtered": True},
            "interval -1": {"interval": -1.0, "filtered": True}}
    names = ["oven.k1", "hall.di1", "tank.ai1", "oven/State"]
    told = {way: li.watch(*names, **how) for way, how in ways.items()}
    for way, its in told.items():
        for name, value in (("oven.k1", False), ("tank.ai1", 8.71), ("oven/State", "online")):
            s.told(f"watch, {way}: from the beginning", its, name, (GOOD, value))
    s.sim.do("hall.di1 = 1")
    for way, its in told.items():
        s.told(f"watch, {way}: a change", its, "hall.di1", (GOOD, True))
    s.sim.do("hall.di1 = 0")
    s.check("watch, filter: a change", li.write("oven.k1", True), GOOD, "write")
    for way, its in told.items():
        s.told(f"watch, {way}: a change", its, "oven.k1", (GOOD, True))
        s.told(f"watch, {way}: a change", its, "hall.di1", (GOOD, False))
    since = {way: its.count("oven.k1") for way, its in told.items()}
    s.sim.do("power oven off")
    for way, its in told.items():
        entry = f"watch, {way}: a dead module"
        s.told(entry, its, "oven.k1", (GONE, None))
        s.told(entry, its, "oven/State", (GOOD, "offline"))
        s.told(entry, its, "hall.di1", (GOOD, False), "the others go on")
    s.reads("read: a dead module", li, "oven.k1", (GONE, None))
    s.check("write: a dead module", li.write("oven.k1", True), "Uncertain", "it may have acted")
    s.check("write: a dead module", li.write("hall.do0", True), GOOD, "the others go on")
    s.check("write: a dead module", li.write("hall.do0", False), GOOD, "the others go on")
    s.sim.do("power oven on")
    for way, its in told.items():
        entry = f"watch, {way}: a dead module"
        s.told(entry, its, "oven.k1", (GOOD, False), "with power")
        # Its relay fell: never was it said to be on as something known.
        s.check(entry, (GOOD, True) in its.all("oven.k1", since[way]), False, "never on")
    exact = told["interval 0"].got
    for way, its in told.items():
        for name in its.got:
            times = [at for _, _, at in its.got[name] if at]
            # Those of the readings, whatever the interval.
            known = {at for _, _, at in exact[name]}
            entry = f"watch, {way}: source times"
            s.check(entry, [at for at in times if at not in known][1:], [], name)
            s.check(entry, times, sorted(times), name)
    untimed = told["interval -1"].got.get("tank.ai1", [])
    s.check("watch, interval -1: source times",
            [at for _, _, at in untimed if at], [], "none that would be false")


def stale(s, li):
    """A value grows too old while its module answers: a status that changes alone is told."""
    ways = {"no filter": {}, "filter": {"filtered": True}}
    told = {way: li.watch("yard.k1", **how) for way, how in ways.items()}
    old = {"no filter": (STALE, None), "filter": (STALE, False)}
    for way, its in told.items():
        until(lambda: {(GOOD, False), old[way]} <= set(its.all("yard.k1")))
        seen = set(its.all("yard.k1"))
        s.check(f"watch, {way}: stale", seen, {(GOOD, False), old[way]}, "all that was told")
        entry = f"watch, {way}: source times"
        good = [at for status, _, at in its.got["yard.k1"] if status == GOOD]
        aged = [at for status, value, at in its.got["yard.k1"] if status == STALE]
        s.check(entry, all(good) and all(aged), True, "each has one")
        s.check(entry, set(aged) <= set(good) | {aged[0]}, True, "that of the reading")
    until(lambda: li.read("yard.k1")[0] == STALE)
    s.check("read: stale", li.read("yard.k1")[:2], (STALE, False), "the last value, as such")


def paused(s, li):
    """An item that was told nothing for a while is told how it is."""
    entry = "watch: after a pause"
    told = li.watch("oven.k3", filtered=True)
    s.told(entry, told, "oven.k3", (GOOD, False), "before")
    li.mode(told, ua.MonitoringMode.Disabled)
    s.check(entry, li.write("oven.k3", True), GOOD, "meanwhile")
    li.mode(told, ua.MonitoringMode.Reporting)
    s.told(entry, told, "oven.k3", (GOOD, True), "enabled again")
    entry = "watch: a shorter queue"
    slow = li.watch("oven.k3", filtered=True, period=3000)
    s.told(entry, slow, "oven.k3", (GOOD, True), "before")
    for on in (False, True, False):
        s.check(entry, li.write("oven.k3", on), GOOD, "more than one waits")
    li.shorten(slow)
    s.told(entry, slow, "oven.k3", (GOOD, False), "the newest")


def written(s, li):
    """What a write says is so."""
    entry = "write: switched and read back"
    for name, module, nth in (("oven.k1", "oven", 0), ("hall.do0", "hall", 0),
                              ("tank.k2", "tank", 1)):
        for on in (True, False):
            s.check(entry, li.write(name, on), GOOD, name)
            s.check(entry, s.sim.outputs(module)[nth], int(on), f"the relay of {name}")
            s.check(entry, li.read(name)[:2], (GOOD, on), f"read at once: {name}")
    entry = "write: several at once"
    writes = [("oven.k1", True), ("oven.k3", True), ("hall.do1", True), ("oven.k6", True),
              ("hall.di0", True), ("oven.k9", True)]
    want = [GOOD, GOOD, GOOD, "BadNotWritable", "BadNotWritable", UNKNOWN]
    s.check(entry, li.statuses(writes), want, "statuses")
    s.check(entry, s.sim.outputs("oven"), [1, 0, 1, 0, 0, 0, 0, 0], "oven")
    s.check(entry, s.sim.outputs("hall")[1], 1, "hall")
    s.check(entry, li.statuses([("oven.k1", False), ("oven.k1", True), ("oven.k1", False)]),
            [GOOD] * 3, "the same three times")
    s.check(entry, li.read("oven.k1")[1], False, "the last one")
    entry = "write: refused"
    for name, value, want in (
        ("oven.k6", True, "BadNotWritable"), ("hall.di0", True, "BadNotWritable"),
        ("oven/State", True, "BadNotWritable"), ("oven.k7", True, "BadInvalidState"),
        ("oven.k2", 1, "BadTypeMismatch"), ("oven.k2", "true", "BadTypeMismatch"),
        ("oven.k2", 1.0, "BadTypeMismatch"), ("oven.k2", [True], "BadTypeMismatch"),
    ):
        s.check(entry, li.write(name, value), want, f"{name} {value!r}")
    s.check(entry, li.write("oven.k4", True), GOOD, "interlocked with k5")
    s.check(entry, li.write("oven.k5", True), "BadInvalidState", "interlocked with k4")
    s.check(entry, s.sim.outputs("oven"), [0, 0, 1, 1, 0, 0, 0, 0], "relays")
    for name in ("oven.k3", "oven.k4", "hall.do1"):
        li.write(name, False)
    s.sim.do("fault oven stuck k2")
    entry = "write: a relay that does not move"
    status = li.write("oven.k2", True)
    # Where a machine stands still, all read-backs may be lost. Then the reply of the module is the
    # end of the command, and it is said to be no more than that.
    end = s.ask("GET", "/audit?limit=1")["items"][0]["end"]
    s.check(entry, (status, end) in (("BadDeviceFailure", "not_verified"), (GOOD, "reply")), True,
            f"k2: {status}, {end}")
    s.sim.do("fault clear")


def called(s, li):
    """Methods."""
    entry = "call: done"
    status, (end, code, audit) = li.call("oven", "Toggle", "k1")
    s.check(entry, (status, end, code, len(audit) > 8), (GOOD, "readback", "", True), "Toggle")
    s.check(entry, s.sim.outputs("oven")[0], 1, "k1")
    told = li.watch("oven.k2")
    width = ua.Variant(300, ua.VariantType.UInt32)
    status, (end, code, _) = li.call("oven", "Pulse", "k2", width)
    s.check(entry, (status, end, code), (GOOD, "readback", ""), "Pulse")
    until(lambda: told.newest("oven.k2") == (GOOD, False) and (GOOD, True) in told.all("oven.k2"))
    s.check(entry, told.newest("oven.k2"), (GOOD, False), "the end of the pulse")
    s.check(entry, s.sim.outputs("oven"), [1, *OFF[1:]], "the end of the pulse")
    status, (end, _, _) = li.call("hall", "AllOff")
    s.check(entry, (status, end, s.sim.outputs("hall")), (GOOD, "readback", [0] * 4), "AllOff")
    entry = "call: refused"
    for arguments, want in (
        (("oven", "Toggle", "k9"), UNKNOWN), (("oven", "Toggle", "k6"), "BadNotWritable"),
        (("oven", "Toggle", 5), "BadInvalidArgument"),
        (("oven", "Pulse", "k1"), "BadArgumentsMissing"),
        (("oven", "Pulse", "k7", width), "BadInvalidState"),
        (("hall", "Toggle", "di0"), "BadNotWritable"), (("oven", "Nothing"), "BadMethodInvalid"),
        (("oven", "AllOff"), "BadInvalidState"),
    ):
        status, outputs = li.call(*arguments)
        s.check(entry, (status, outputs), (want, []), f"{arguments}")
    s.check(entry, s.sim.outputs("oven"), [1, *OFF[1:]], "relays")
    li.write("oven.k1", False)


def rights(s):
    """What an account may not do does not move."""
    entry = "rights: {points,role,nobody,token}"
    with s.session("wang") as wang:
        s.check("rights: points", wang.write("oven.k1", True), GOOD, "his own")
        for name in ("oven.k2", "hall.do0"):
            s.check("rights: points", wang.write(name, True), "BadUserAccessDenied", name)
        s.check("rights: points", wang.call("oven", "Toggle", "k2")[0], "BadUserAccessDenied", "k2")
        s.check("rights: points", wang.call("oven", "AllOff")[0], "BadUserAccessDenied", "AllOff")
        s.check("rights: points", wang.write("oven.k1", False), GOOD, "his own")
        level = wang.read("oven.k1", ua.AttributeIds.UserAccessLevel)[1] & 2
        other = wang.read("oven.k2", ua.AttributeIds.UserAccessLevel)[1] & 2
        s.check("rights: points", (level, other), (2, 0), "what he is told that he may write")
    token = s.ask("POST", "/tokens", {"name": "grafana", "role": "viewer"})["token"]
    for kind, how in (("role", {"user": "guest"}), ("nobody", {"user": None}),
                      ("token", {"user": "any", "password": token})):
        with s.session(**how) as session:
            s.check(f"rights: {kind}", session.read("tank.ai1")[:2], (GOOD, 8.71), "reads")
            status = session.write("oven.k1", True)
            s.check(f"rights: {kind}", status, "BadUserAccessDenied", "write")
            status = session.call("oven", "Toggle", "k1")[0]
            s.check(f"rights: {kind}", status, "BadUserAccessDenied", "call")
    s.check(entry, s.sim.outputs("oven"), OFF, "relays")
    audit = s.ask("GET", "/audit")["items"]
    whose = {each["who"] for each in audit if each["via"] == "opcua:scada"}
    s.check("rights: points", whose, {"li", "wang"}, "who did it")
    for user, password in (("li", "wrong"), ("nobody", PASSWORD), ("li", "")):
        s.check("rights: a wrong password", refused(lambda: s.session(user, password=password)),
                "BadIdentityTokenRejected", user)


def refused(connect):
    """Why a session is refused."""
    try:
        connect().close()
    except ua.UaStatusCodeError as error:
        return ua.StatusCode(error.code).name
    except Exception as error:
        return type(error).__name__
    return GOOD


def kept(s):
    """The history."""
    entry = "history: as it was"
    began = datetime.datetime.now(datetime.timezone.utc)
    with s.session() as li:
        for on in (True, False, True, False):
            li.write("oven.k8", on)
        # What is kept is written once a second.
        want = [(GOOD, True), (GOOD, False), (GOOD, True), (GOOD, False)]
        end = began + datetime.timedelta(hours=1)
        values = lambda *how, **more: [each[:2] for each in li.history("oven.k8", *how, **more)]
        until(lambda: values(began, end) == want)
        s.check(entry, values(began, end), want, "forward")
        s.check(entry, values(end, began), want[::-1], "backward")
        s.check(entry, values(began, end, 1), want, "one at a time")
        s.check(entry, values(end, began, 3), want[::-1], "three at a time, backward")
        s.check(entry, values(began, None, 2, pages=1), want[:2], "the first two")
        s.check(entry, values(None, end, 2, pages=1), want[::-1][:2], "the last two")
        without = ("BadBoundNotFound", None)
        bounds = [(GOOD, False), *want, without]
        s.check(entry, values(began, end, 0, True), bounds, "with what it lies between")
        times = [each[2] for each in li.history("oven.k8", began, end)]
        s.check(entry, times, sorted(times), "times")
        nothing = values(end, end + datetime.timedelta(hours=1))
        s.check(entry, nothing, [], "of tomorrow")


def many(s):
    """More clients than there may be."""
    entry = "limits: sessions and connections"
    # Each address has eight connections, of which those that say nothing end by themselves.
    silent = [socket.create_connection((HOST, s.port)) for _ in range(10)]
    until(lambda: s.outlet()["dropped"] >= 2)
    s.check(entry, s.outlet()["dropped"] >= 2, True, "more than eight of one address")
    until(lambda: s.outlet()["clients"] == 0)
    s.check(entry, s.outlet()["clients"], 0, "silent ones end")
    for each in silent:
        each.close()
    with s.session() as li:
        s.check(entry, li.read("oven.k1")[0], GOOD, "afterwards")
    # A message that says it is huge, and one that is no message.
    for data in (b"HELF\xff\xff\xff\x7f" + bytes(100), b"GET / HTTP/1.1\r\n\r\n", bytes(64)):
        with socket.create_connection((HOST, s.port)) as wrong:
            wrong.settimeout(20)
            wrong.sendall(data)
            try:
                while wrong.recv(4096):
                    pass
                end = "closed"
            except ConnectionResetError:
                end = "closed"
            except TimeoutError:
                end = "open"
        s.check(entry, end, "closed", f"{data[:8]!r}")


# Certificates ----------------------------------------------------------------------------------


def secured():
    """Who is trusted, over both policies."""
    with Plant() as s:
        certificates = Certificates(s.folder.name, CLIENT, STRANGER)
        how = lambda policy, name=CLIENT: {
            "policy": policy, "files": certificates.files(name), "called": name}
        entry = "security: a client that is not trusted"
        policy = next(iter(POLICIES))
        s.check(entry, refused(lambda: s.session(**how(policy))), UNTRUSTED, "the first time")
        until(s.problem)
        thumbprint = certificates.thumbprint(CLIENT)
        said = s.problem()
        s.check(entry, said.get("code"), "E0933", "the last error")
        digits = thumbprint.replace(":", "").lower()
        s.check(entry, digits in said.get("reason", ""), True, "its thumbprint is told")
        s.check(entry, refused(lambda: s.session(**how(policy))), UNTRUSTED, "once more")
        s.configure(trusted=[thumbprint])
        for policy in POLICIES:
            with s.session(**how(policy)) as li:
                entry = f"security: {policy}"
                s.check(entry, li.write("oven.k1", True), GOOD, "write")
                s.check(entry, li.read("oven.k1")[:2], (GOOD, True), "read")
                s.check(entry, li.write("oven.k1", False), GOOD, "write")
            other = refused(lambda: s.session(**how(policy, STRANGER)))
            s.check(f"security: {policy}", other, UNTRUSTED, "another one")
            wrong = refused(lambda: s.session(password="wrong", **how(policy)))
            s.check(f"security: {policy}", wrong, "BadIdentityTokenRejected", "a wrong password")
        entry = "security: nobody without signing in"
        for kind, more in (("encrypted", how(policy)), ("on this machine", {})):
            said = refused(lambda more=more: s.session(None, **more))
            s.check(entry, said, "BadIdentityTokenInvalid", kind)
        s.configure(trusted=[])
        entry = "security: a client that is not trusted"
        s.check(entry, refused(lambda: s.session(**how(policy))), UNTRUSTED, "any more")
        endpoints(s)
        keys(s)
    return s.tally


def endpoints(s):
    """What is offered, here and to others."""
    entry = "security: without encryption on this machine only"
    offered = lambda: {(each.SecurityPolicyUri.split("#")[1], each.SecurityMode.name)
                       for each in asked_for(s)}
    both = {(name, "SignAndEncrypt") for name in POLICIES}
    s.check(entry, offered(), both | {("None", "None_")}, "on this machine")
    s.configure(listen=f"0.0.0.0:{s.port}")
    s.check(entry, offered(), both, "for others")
    s.check(entry, refused(lambda: s.session()), "ConnectionError", "without encryption")
    s.check(entry, [created(s) for _ in range(25)], [False] * 25, "sessions that nobody uses")
    s.check(entry, offered(), both, "asked for afterwards")
    s.configure()
    s.check(entry, created(s), True, "a session on this machine")


def created(s):
    """Whether a session can be created without encryption, by who does not sign in."""
    from asyncua import Client
    from asyncua.sync import ThreadLoop

    with ThreadLoop() as loop:
        client = Client(f"opc.tcp://{HOST}:{s.port}/", timeout=5)
        try:
            loop.post(client.connect_socket())
            loop.post(client.send_hello())
            loop.post(client.open_secure_channel())
            loop.post(client.create_session())
        except Exception:
            return False
        finally:
            client.disconnect_socket()
    return True


def asked_for(s):
    """The endpoints."""
    from asyncua import Client
    from asyncua.sync import ThreadLoop

    with ThreadLoop() as loop:
        client = Client(f"opc.tcp://{HOST}:{s.port}/")
        return loop.post(client.connect_and_get_server_endpoints())


def keys(s):
    """Its key is its owner's."""
    entry = "security: the key is its owner's alone"
    folder = os.path.join(s.folder.name, "state", "opcua-scada.pki")
    modes = [os.stat(os.path.join(folder, path)).st_mode & 0o777
             for path in ("", "private/private.pem")]
    s.check(entry, modes, [0o700, 0o600], "modes")


# The connection ----------------------------------------------------------------------------------


def life():
    """The daemon, the line and the configuration go and come."""
    with Plant() as s:
        renamed(s)
        revoked(s)
        unplugged(s)
        killed(s)
    return s.tally


def renamed(s):
    """A module that is renamed while somebody watches."""
    entry = "a reload: what is gone is said, and the others go on"
    with s.session() as li:
        told = li.watch("tank.ai1", "oven.k1")
        s.told(entry, told, "tank.ai1", (GOOD, 8.71), "before")
        text = s.daemon.config.read_text(encoding="utf-8")
        s.daemon.config.write_text(text.replace("[module.tank", "[module.vat"), encoding="utf-8")
        s.daemon.process.send_signal(signal.SIGHUP)
        s.told(entry, told, "tank.ai1", (UNKNOWN, None), "under its old name")
        s.check(entry, li.read("tank.ai1")[0], UNKNOWN, "read")
        s.reads(entry, li, "vat.ai1", (GOOD, 8.71), "under its new name")
        s.check(entry, li.write("oven.k1", True), GOOD, "in the same session")
        s.told(entry, told, "oven.k1", (GOOD, True), "in the same subscription")
        s.check(entry, li.write("oven.k1", False), GOOD, "in the same session")
        s.check(entry, li.watch("tank.ai1").refused, [UNKNOWN], "watched under its old name")


def revoked(s):
    """Who is locked sees nothing any more."""
    entry = "an account that is locked: its connections end"
    li = s.session()
    told = li.watch("oven.k2")
    s.told(entry, told, "oven.k2", (GOOD, False), "before")
    # Many commands of one request are under way when the account is locked.
    writes = [("oven.k4", nth % 2 == 0) for nth in range(2000)]
    busy = threading.Thread(target=lambda: failed(lambda: li.statuses(writes)))
    busy.start()
    until(lambda: s.sim.outputs("oven")[3] == 1)
    s.ask("PATCH", "/users/li", {"locked": True})
    busy.join()
    until(lambda: s.outlet()["clients"] == 0)
    whose = lambda: [each["id"] for each in s.ask("GET", "/audit")["items"]
                     if each["who"] == "li"]
    ended = whose()[0]
    until(lambda: s.ask("GET", "/points/oven/k4")["quality"] == "good")
    s.check(entry, whose()[0], ended, "nothing more is switched in its name")
    s.check(entry, s.outlet()["clients"], 0, "connections")
    with s.session("admin") as admin:
        s.check(entry, admin.write("oven.k2", True), GOOD, "others")
        s.check(entry, told.newest("oven.k2"), (GOOD, False), "it is told nothing more")
        s.check(entry, admin.write("oven.k2", False), GOOD, "others")
    s.check(entry, refused(lambda: s.session()), "BadIdentityTokenRejected", "again")
    li.close()
    s.ask("PATCH", "/users/li", {"locked": False})
    with s.session() as again:
        s.check(entry, again.read("oven.k2")[:2], (GOOD, False), "unlocked")


def unplugged(s):
    """The port is gone."""
    entry = "a line that is gone: every value is said to be"
    with s.session() as li:
        told = li.watch("oven.k1", "hall.di0", "line/main/State", filtered=True)
        s.told(entry, told, "hall.di0", (GOOD, True), "before")
        s.sim.kill()
        for name in ("oven.k1", "hall.di0"):
            s.told(entry, told, name, (GONE, None), "without")
        s.told(entry, told, "line/main/State", (GOOD, "absent"), "without")
        status = li.write("oven.k1", True)
        s.check(entry, status in ("BadOutOfService", GONE, "Uncertain"), True, f"write: {status}")
        s.sim.start()
        s.told(entry, told, "hall.di0", (GOOD, True), "back again")


def killed(s):
    """kill -9: clients know, and come back to the same certificate and nodes."""
    entry = "kill -9: the same server afterwards"
    with s.session() as li:
        before = asked_for(s)[0].ServerCertificate
        s.daemon.end("KILL")
        until(lambda: failed(lambda: li.read("oven.k1")))
        s.check(entry, failed(lambda: li.read("oven.k1")), True, "the client knows")
    s.daemon.start()
    s.settled()
    s.check(entry, asked_for(s)[0].ServerCertificate, before, "certificate")
    with s.session() as li:
        s.reads(entry, li, "oven.k1", (GOOD, False))


def failed(what):
    """Whether it breaks off."""
    try:
        what()
    except Exception:
        return True
    return False


SUITES = [
    ("OPC UA", suite),
    ("OPC UA, certificates", secured),
    ("OPC UA, life", life),
]

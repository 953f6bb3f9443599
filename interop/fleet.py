"""What the suite of the fleet needs: its NATS servers as `railbus fleet init` makes them, and
nats-py as a site and as a centre."""

import asyncio
import base64
import importlib.util
import json
import logging
import os
import pathlib
import shutil
import socket
import ssl
import subprocess
import sys
import tempfile
import threading

import grpc_tools.protoc
import nats
import nkeys
from nats.js import api

from modbus_tcp import HOST, PATIENCE, PROGRAM
from rig import ROOT

SERVER = pathlib.Path(sys.executable).parent / "nats-server"
# The port of the other servers is so much higher than that of clients.
ROUTE_OFFSET = 2000

# A TLS connection that a server ends is nothing to be told of.
logging.getLogger("asyncio").setLevel(logging.ERROR)

# What a server says where rights are missing.
FORBIDDEN = "permissions violation"
# After this time it is known that somebody listens, in seconds.
INTEREST = 5.0
# A question that may be lost is asked again after this time, in seconds.
ASKED_AGAIN = 2.0
# So long at most the client takes to tell of it, in seconds.
SAID_WITHIN = 10.0

# The streams of the centre: name, subjects, and what is set besides.
STREAMS = (
    ("DATA", "rb.up.*.data", {"duplicate_window": 120}),
    ("EVENT", "rb.up.*.event", {"duplicate_window": 120}),
    ("STATE", "rb.up.*.state", {"max_msgs_per_subject": 1}),
    ("DESIRED", "rb.desired.*.*", {"allow_direct": True, "max_msgs_per_subject": 20}),
    ("LEDGER", "rb.cmd.*.*", {"max_msgs_per_subject": 3}),
    ("FLEET", "rb.fleet.*.*", {"max_msgs_per_subject": 20}),
    ("AUDIT", "rb.audit", {"deny_delete": True, "deny_purge": True}),
)


def node_ports(count):
    """Ports on which nothing listens, nor on those of their routes; held for whom they are given
    to."""
    held, ports = [], []
    while len(ports) < count:
        pair = [socket.socket(), socket.socket()]
        try:
            pair[0].bind((HOST, 0))
            port = pair[0].getsockname()[1]
            pair[1].bind((HOST, port + ROUTE_OFFSET))
            # A server takes it from now on. Set before, it would let another suite have the port.
            for each in pair:
                each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        except (OSError, OverflowError):
            for each in pair:
                each.close()
            continue
        held += pair
        ports.append(port)
    return held, ports


def railbus(*words):
    """Runs the program; returns its exit code and what it said."""
    ran = subprocess.run([PROGRAM, *words], capture_output=True, text=True, check=False)
    return ran.returncode, ran.stdout + ran.stderr


class Fleet:
    """A fleet with its servers at work."""

    def __init__(self, count=3):
        self.place = tempfile.TemporaryDirectory(prefix="railbus-fleet-")
        self.folder = pathlib.Path(self.place.name) / "acme"
        self.held, self.ports = node_ports(count)
        nodes = ",".join(f"{HOST}:{port}" for port in self.ports)
        code, said = railbus("fleet", "init", str(self.folder), "--nats", nodes)
        if code:
            raise RuntimeError(said)
        self.servers = [None] * count
        for at in range(count):
            self.start(at)

    def start(self, at):
        """Starts a server, with what it has on its disk."""
        folder = self.folder / f"server{at + 1}"
        with open(folder / "log", "a", encoding="utf-8") as log:
            self.servers[at] = subprocess.Popen(
                [SERVER, "-c", "nats.conf"], cwd=folder, stdout=log, stderr=log)

    def kill(self, at):
        """Ends a server at once."""
        if self.servers[at]:
            self.servers[at].kill()
            self.servers[at].wait(PATIENCE)
            self.servers[at] = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for at in range(len(self.servers)):
            self.kill(at)
        for each in self.held:
            each.close()
        self.place.cleanup()

    def hub(self, name):
        """The path of a file of the centre."""
        return str(self.folder / "hub" / name)

    def creds(self, site, nth=""):
        """The path of a site's credentials, made the first time; of another key, if one is
        named."""
        path = self.folder / f"{site}{nth}.creds"
        if not path.exists():
            code, said = railbus("fleet", "creds", str(self.folder), site, str(path))
            if code:
                raise RuntimeError(said)
        return str(path)

    def expiring(self, site, at):
        """The path of a site's credentials that are valid until this time in seconds since 1970."""
        token, seed = inside(self.creds(site))
        key = (self.folder / "hub/site-signing.nk").read_text(encoding="utf-8").strip()
        token = signed({**claims_of(token), "exp": at}, key)
        return write_creds(self.folder / f"{site}.expiring.creds", token, seed)

    def tls(self):
        """Trusts the authority of the fleet, and no other."""
        return ssl.create_default_context(cafile=self.hub("ca.pem"))

    async def connect(self, creds, inbox, at=0, **more):
        """A client with these credentials, all at the same server, so that all that is said comes
        in one order."""
        said = []

        async def error(problem):
            said.append(str(problem))

        options = {"tls": self.tls(), "allow_reconnect": False, "connect_timeout": PATIENCE}
        client = await nats.connect(
            f"tls://{HOST}:{self.ports[at]}", user_credentials=creds, error_cb=error,
            inbox_prefix=inbox.encode(), **{**options, **more})
        client.said = said
        return client

    async def centre(self):
        """The centre, once the servers have found each other, with its streams."""
        deadline = asyncio.get_running_loop().time() + PATIENCE
        hub = None
        while True:
            try:
                hub = hub or await self.connect(self.hub("hub.creds"), "_INBOX.hub")
                await self.make_streams(hub)
                return hub
            except (OSError, asyncio.TimeoutError, nats.errors.Error):
                # Not before a leader is chosen.
                if asyncio.get_running_loop().time() > deadline:
                    raise
                await asyncio.sleep(0.1)

    async def make_streams(self, hub):
        """Makes the streams, which may be there already."""
        streams = hub.jetstream(timeout=ASKED_AGAIN)
        for name, subject, more in STREAMS:
            config = api.StreamConfig(
                name=name, subjects=[subject], num_replicas=len(self.ports), **more)
            await streams.add_stream(config)

    async def site(self, site):
        """A site."""
        return await self.connect(self.creds(site), f"_INBOX.{site}")


def messages():
    """What sites and centre say to each other, as the published description has it."""
    folder = tempfile.mkdtemp(prefix="railbus-proto-")
    protoc = ["protoc", f"-I{ROOT / 'crates/fleet/proto'}", f"--python_out={folder}",
              "railbus.proto"]
    if grpc_tools.protoc.main(protoc):
        raise RuntimeError("railbus.proto is not understood")
    spec = importlib.util.spec_from_file_location("railbus_pb2", f"{folder}/railbus_pb2.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    shutil.rmtree(folder)
    return module


class Centre:
    """A centre by others: it gives sessions, and keeps what it hears. On a thread of its own."""

    def __init__(self, fleet):
        self.fleet, self.form = fleet, messages()
        self.loop = asyncio.new_event_loop()
        threading.Thread(target=self.loop.run_forever, daemon=True).start()
        self.hub = self.hellos_from = None
        # None: sessions are given. Otherwise code and reason.
        self.refusal = None
        self.sessions = 0
        # By the last word of their subjects, with the names of their sites.
        self.heard = {kind: [] for kind in ("hello", "beat", "data", "state")}
        self.run(self._start())

    def run(self, what):
        """Does this on its thread."""
        return asyncio.run_coroutine_threadsafe(what, self.loop).result(2 * PATIENCE)

    async def _start(self):
        self.hub = await self.fleet.centre()
        for kind, form in (("beat", self.form.Beat), ("data", self.form.Batch),
                           ("state", self.form.State)):

            async def note(message, kind=kind, form=form):
                site = message.subject.split(".")[2]
                self.heard[kind].append((site, form.FromString(message.data)))

            await self.hub.subscribe(f"rb.up.*.{kind}", cb=note)
        await self._listen()

    async def _listen(self):
        async def hello(message):
            said = self.form.Hello.FromString(message.data)
            self.heard["hello"].append((message.subject.split(".")[2], said))
            answer = self.form.Welcome()
            if self.refusal:
                answer.refusal.code, answer.refusal.reason = self.refusal
            else:
                self.sessions += 1
                answer.session = f"session-{self.sessions}"
            await message.respond(answer.SerializeToString())

        self.hellos_from = await self.hub.subscribe("rb.up.*.hello", "hub", cb=hello)
        await flushed(self.hub)

    def listen(self):
        """It is there."""
        self.run(self._listen())

    def leave(self):
        """It is away; the servers are not."""
        async def away():
            await self.hellos_from.unsubscribe()
            await flushed(self.hub)

        self.run(away())

    def ask(self, subject, payload=b""):
        """Asks a site; None if it does not listen."""
        async def asks():
            try:
                return (await asked(self.hub, subject, payload)).data
            except nats.errors.NoRespondersError:
                return None

        return self.run(asks())

    def again(self):
        """Connects again, after the servers were away."""
        self.run(self._start())

    def stored(self, stream="DATA"):
        """All that a stream has: a message each, with its headers."""
        async def reads():
            streams = self.hub.jetstream(timeout=PATIENCE)
            state = (await streams.stream_info(stream)).state
            numbers = range(state.first_seq, state.last_seq + 1)
            return [await streams.get_msg(stream, seq) for seq in numbers if state.messages]

        return [(message.headers, self.form.Batch.FromString(message.data))
                for message in self.run(reads())]

    def leader_elsewhere(self, stream="DATA"):
        """The place of the server that leads a stream, once that is not the one to which this
        centre is connected."""
        async def finds():
            # Questions are lost while nobody leads.
            streams = self.hub.jetstream(timeout=ASKED_AGAIN)
            deadline = asyncio.get_running_loop().time() + PATIENCE / 2
            while asyncio.get_running_loop().time() < deadline:
                try:
                    cluster = (await streams.stream_info(stream)).cluster
                except (nats.errors.Error, asyncio.TimeoutError):
                    continue
                if cluster and cluster.leader and cluster.leader != "server1":
                    return int(cluster.leader.removeprefix("server")) - 1
                await self.hub.publish(f"$JS.API.STREAM.LEADER.STEPDOWN.{stream}",
                                       b'{"placement": {"preferred": "server2"}}')
                await asyncio.sleep(0.5)
            return 0

        return self.run(finds())

    def forget(self, stream="DATA"):
        """The servers lose what a stream has."""
        self.run(self.hub.jetstream(timeout=PATIENCE).purge_stream(stream))

    def close(self):
        """Ends it."""
        self.run(self.hub.close())
        self.loop.call_soon_threadsafe(self.loop.stop)


async def flushed(client):
    """The server has taken all that this client said. The client's own `flush` does not wait for
    what is still to be written: its PING overtakes that."""
    async with asyncio.timeout(PATIENCE):
        while client.is_connected and client.pending_data_size:
            await asyncio.sleep(0)
    await client.flush(timeout=PATIENCE)


async def asked(client, subject, payload, within=INTEREST):
    """The answer to a request. That somebody listens takes a moment to be known in another
    account."""
    deadline = asyncio.get_running_loop().time() + within
    while True:
        try:
            return await client.request(subject, payload, timeout=PATIENCE)
        except nats.errors.NoRespondersError:
            if asyncio.get_running_loop().time() > deadline:
                raise
            await asyncio.sleep(0.05)


async def forbidden(client, act, subject):
    """Whether the server says that this is forbidden at this subject."""
    before = len(client.said)
    await act()
    # The server complains before it answers this; the client tells of it a moment later.
    await flushed(client)
    wanted = f'"{subject.lower()}"'
    deadline = asyncio.get_running_loop().time() + SAID_WITHIN
    while True:
        said = [text for text in client.said[before:] if FORBIDDEN in text and wanted in text]
        if said or asyncio.get_running_loop().time() > deadline:
            return len(said)
        await asyncio.sleep(0)


def inside(path):
    """The two secrets of a file with credentials: claims and seed."""
    lines = pathlib.Path(path).read_text(encoding="utf-8").splitlines()
    token = next(line for line in lines if line.startswith("ey"))
    seed = next(line for line in lines if line.startswith("SU"))
    return token, seed


def claims_of(token):
    """What a token says."""
    body = token.split(".")[1]
    return json.loads(base64.urlsafe_b64decode(body + "=" * (-len(body) % 4)))


def unsigned(claims):
    """A token for these claims, but for its signature."""
    def part(value):
        return base64.urlsafe_b64encode(json.dumps(value).encode()).rstrip(b"=").decode()

    return f"{part({'typ': 'JWT', 'alg': 'ed25519-nkey'})}.{part(claims)}"


def signed(claims, seed):
    """A token for these claims, signed by this key."""
    text = unsigned(claims)
    sign = nkeys.from_seed(seed.encode()).sign(text.encode())
    return f"{text}.{base64.urlsafe_b64encode(sign).rstrip(b'=').decode()}"


def write_creds(path, token, seed):
    """A file with credentials."""
    text = (f"-----BEGIN NATS USER JWT-----\n{token}\n------END NATS USER JWT------\n\n"
            f"-----BEGIN USER NKEY SEED-----\n{seed}\n------END USER NKEY SEED------\n")
    with open(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600), "w",
              encoding="utf-8") as file:
        file.write(text)
    return str(path)

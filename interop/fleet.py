"""What the suite of the fleet needs: its NATS servers as `railbus fleet init` makes them, and
nats-py as a site and as a centre."""

import asyncio
import logging
import os
import pathlib
import socket
import ssl
import subprocess
import sys
import tempfile

import nats
from nats.js import api

from modbus_tcp import HOST, PATIENCE, PROGRAM

SERVER = pathlib.Path(sys.executable).parent / "nats-server"
# The port of the other servers is so much higher than that of clients.
ROUTE_OFFSET = 2000

# A TLS connection that a server ends is nothing to be told of.
logging.getLogger("asyncio").setLevel(logging.ERROR)

# What a server says where rights are missing.
FORBIDDEN = "permissions violation"
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
        for each in pair:
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            pair[0].bind((HOST, 0))
            port = pair[0].getsockname()[1]
            pair[1].bind((HOST, port + ROUTE_OFFSET))
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
        self.servers = []
        for at in range(count):
            folder = self.folder / f"server{at + 1}"
            with open(folder / "log", "w", encoding="utf-8") as log:
                self.servers.append(subprocess.Popen(
                    [SERVER, "-c", "nats.conf"], cwd=folder, stdout=log, stderr=log))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for server in self.servers:
            server.kill()
            server.wait(PATIENCE)
        for each in self.held:
            each.close()
        self.place.cleanup()

    def hub(self, name):
        """The path of a file of the centre."""
        return str(self.folder / "hub" / name)

    def creds(self, site):
        """The path of a site's credentials, made the first time."""
        path = self.folder / f"{site}.creds"
        if not path.exists():
            code, said = railbus("fleet", "creds", str(self.folder), site, str(path))
            if code:
                raise RuntimeError(said)
        return str(path)

    def tls(self):
        """Trusts the authority of the fleet, and no other."""
        return ssl.create_default_context(cafile=self.hub("ca.pem"))

    async def connect(self, creds, inbox, **more):
        """A client with these credentials, at the first server, so that all that is said comes in
        one order."""
        said = []

        async def error(problem):
            said.append(str(problem))

        options = {"tls": self.tls(), "allow_reconnect": False, "connect_timeout": PATIENCE}
        client = await nats.connect(
            f"tls://{HOST}:{self.ports[0]}", user_credentials=creds, error_cb=error,
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
        streams = hub.jetstream(timeout=PATIENCE)
        for name, subject, more in STREAMS:
            config = api.StreamConfig(
                name=name, subjects=[subject], num_replicas=len(self.ports), **more)
            await streams.add_stream(config)

    async def site(self, site):
        """A site."""
        return await self.connect(self.creds(site), f"_INBOX.{site}")


async def forbidden(client, act, subject):
    """Whether the server says that this is forbidden at this subject."""
    before = len(client.said)
    await act()
    # The server complains before it answers this; the client tells of it a moment later.
    await client.flush(timeout=PATIENCE)
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


def write_creds(path, token, seed):
    """A file with credentials."""
    text = (f"-----BEGIN NATS USER JWT-----\n{token}\n------END NATS USER JWT------\n\n"
            f"-----BEGIN USER NKEY SEED-----\n{seed}\n------END USER NKEY SEED------\n")
    with open(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600), "w",
              encoding="utf-8") as file:
        file.write(text)
    return str(path)

"""The daemon's Modbus TCP server over TLS: pymodbus' own TLS client, with certificates made by
openssl, reads in every role and switches what its role may."""

import os
import socket
import ssl
import subprocess
import tempfile

from pymodbus.client import ModbusTlsClient

from modbus_cases import DONE, exception
from modbus_tcp import HOST, PATIENCE, UNITS, Plant, Pymodbus, ask, message, words

ADDRESS = exception(2)
# The role stands in this extension of a client's certificate.
ROLE = "1.3.6.1.4.1.50316.802.1"
# What the roles of the clients may switch; `visitor` is not among them.
ROLES = ["gates=gate.*", "bakers=oven.k1", "bakers=oven.k2"]
# The clients, by the roles in their certificates.
CLIENTS = {"gates": ["gates"], "bakers": ["bakers"], "visitor": ["visitor"], "none": [],
           "both": ["gates", "bakers"]}


class Certificates:
    """Certificates and keys in a folder, all made by openssl."""

    def __init__(self, folder):
        self.folder = folder
        self.authority("ca")
        self.authority("other")
        self.issue("server", "ca", "subjectAltName=IP:127.0.0.1")
        for name, roles in CLIENTS.items():
            # openssl writes an extension once: two roles are a list of them, which is none.
            content = "SEQUENCE:several" if len(roles) > 1 else f"UTF8String:{name}"
            self.issue(name, "ca", *[f"{ROLE}=ASN1:{content}"][:len(roles)])
        self.issue("stranger", "other", f"{ROLE}=ASN1:UTF8String:gates")

    def path(self, name, kind):
        """A file."""
        return os.path.join(self.folder, f"{name}.{kind}")

    def openssl(self, *arguments):
        """Runs openssl."""
        subprocess.run(["openssl", *arguments], check=True, cwd=self.folder, capture_output=True)

    def authority(self, name):
        """Somebody who issues certificates."""
        self.openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
                     "-nodes", "-keyout", f"{name}.key", "-out", f"{name}.crt", "-days", "30",
                     "-subj", f"/CN={name}")

    def issue(self, name, authority, *extensions):
        """A certificate with these extensions."""
        # Without any extension it would be of version 1.
        several = "[several]\na=UTF8String:gates\nb=UTF8String:bakers\n"
        text = "\n".join(("basicConstraints=CA:FALSE", *extensions, several))
        with open(self.path(name, "ext"), "w", encoding="utf-8") as file:
            file.write(text)
        self.openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                     "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        self.openssl("x509", "-req", "-in", f"{name}.csr", "-CA", f"{authority}.crt", "-CAkey",
                     f"{authority}.key", "-CAcreateserial", "-days", "30", "-extfile",
                     f"{name}.ext", "-out", f"{name}.crt")

    def settings(self):
        """Those of the server."""
        return {"tls_cert": self.path("server", "crt"), "tls_key": self.path("server", "key"),
                "client_ca": self.path("ca", "crt"), "roles": ROLES}

    def context(self, name):
        """What a client of this name shows and trusts."""
        context = ssl.create_default_context(cafile=self.path("ca", "crt"))
        if name:
            context.load_cert_chain(self.path(name, "crt"), self.path(name, "key"))
        return context


class Secure(Pymodbus):
    """pymodbus over TLS."""

    def __init__(self, port, context):
        # It names no host to the context; who the server is is checked by its authority.
        context.check_hostname = False
        self.context = context
        super().__init__(port)

    def open(self, port):
        return ModbusTlsClient(HOST, port=port, sslctx=self.context, retries=0,
                               trace_packet=self._packet)


def off(module):
    """All outputs of a module off."""
    return [0] * UNITS[module][2]


def security():
    """Clients of all roles, and those who have none of the right certificates."""
    with tempfile.TemporaryDirectory(prefix="railbus-interop-") as folder:
        made = Certificates(folder)
        # Plain, and over TLS: a server of each.
        with Plant(plain={"write": ["*"]}, tls=made.settings()) as s:
            for name in CLIENTS:
                with Secure(s.ports["tls"], made.context(name)) as master:
                    role(s, name, master)
            for name in (None, "stranger"):
                refused(s, name or "without a certificate", made.context(name))
            old = made.context("gates")
            # What a client of TLS 1.1 needs to be allowed to try.
            old.set_ciphers("ALL:@SECLEVEL=0")
            old.minimum_version = ssl.TLSVersion.MINIMUM_SUPPORTED
            old.maximum_version = ssl.TLSVersion.TLSv1_1
            refused(s, "TLS 1.1", old)
            unencrypted(s)
            audited(s)
        return s.tally


def role(s, name, master):
    """What one of these roles may."""
    for module, (unit, first, count) in UNITS.items():
        got = ask(master, unit, 1, first, count)
        s.check(f"TLS, role {name}: reads all", got, off(module), module)
    may = {"gates": [("gate", nth) for nth in range(8)], "bakers": [("oven", 0), ("oven", 1)]}
    may = may.get(name, [])
    for module, nth in (("gate", 0), ("gate", 7), ("oven", 0), ("oven", 1), ("oven", 2),
                        ("hall", 0), ("yard", 3), ("tank", 1), ("door", 0)):
        unit, first, _ = UNITS[module]
        entry, want = f"TLS, role {name}: nothing else moves", ADDRESS
        on = off(module)
        if (module, nth) in may:
            entry, want, on[nth] = f"TLS, role {name}: switches", DONE, 1
        s.check(entry, ask(master, unit, 5, first + nth, [1]), want, f"{module} {nth}")
        s.relays(entry, module, on)
        s.check(entry, ask(master, unit, 5, first + nth, [0]), want, f"{module} {nth}")
        s.relays(entry, module, off(module))


def refused(s, who, context):
    """One that gets no answer."""
    entry, got = f"TLS: refused, {who}", "answered"
    try:
        with socket.create_connection((HOST, s.ports["tls"]), PATIENCE) as plain:
            with context.wrap_socket(plain, server_hostname=HOST) as client:
                client.sendall(message(1, 2, 5, *words(0, 0xFF00)))
                # With TLS 1.3 it is only told here.
                got = "closed" if not client.recv(100) else got
    except (ssl.SSLError, ConnectionError):
        got = "closed"
    s.check(entry, got, "closed", who)
    s.relays(entry, "gate", off("gate"))


def unencrypted(s):
    """Modbus TCP as it is, on the port for TLS."""
    entry, got = "TLS: refused, plain Modbus TCP", "answered"
    try:
        with socket.create_connection((HOST, s.ports["tls"]), PATIENCE) as client:
            client.sendall(message(1, 2, 5, *words(0, 0xFF00)))
            # Perhaps an alert of TLS, but never an answer.
            while data := client.recv(100):
                if data[:2] == b"\0\1":
                    break
            else:
                got = "closed"
    except ConnectionError:
        got = "closed"
    s.check(entry, got, "closed", "a write")
    s.relays(entry, "gate", off("gate"))


def audited(s):
    """The audit log has role and name of who switched."""
    _, answer = s.daemon.ask("GET", "/audit?limit=500")
    vias = {item.get("via", "") for item in answer["items"]}
    for name in ("gates", "bakers"):
        said = any(f"{HOST} role={name} CN={name}" in via for via in vias)
        s.check("TLS: role and name in the audit log", said, True, f"{name}, {vias},")


SUITES = [("Modbus TCP, TLS and roles", security)]

"""Lines go to several TCP clients; a slow client loses lines, receives their number and delays no other client."""

import json
import socket
import time
from pathlib import Path

import pytest

from calstation.connection import LineServer
from calstation.errors import ConfigurationError
from tests.helpers import raises_code


def connect(server: LineServer) -> socket.socket:
    host, port = server.address.rsplit(":", 1)
    client = socket.create_connection((host.strip("[]"), int(port)), timeout=10.0)
    assert server.wait_for_client(10.0)
    return client


def lines(client: socket.socket) -> list[str]:
    with client, client.makefile(encoding="utf-8") as stream:
        return stream.read().splitlines()


def test_every_client_receives_a_greeting_and_every_line():
    server = LineServer("127.0.0.1:0")
    server.greeting = lambda: "hello\n"
    clients = [connect(server), connect(server)]
    for client in clients:  # the greeting shows that it is in the list
        assert client.recv(6) == b"hello\n"
    for k in range(100):
        server.write(f"{k}\n")
    server.close()
    assert [lines(client) for client in clients] == [[str(k) for k in range(100)]] * 2


def test_slow_client_loses_lines_and_receives_their_number():
    server = LineServer("127.0.0.1:0", buffered=10)
    server.greeting = lambda: "hello\n"
    client = connect(server)
    long = "x" * 100_000 + "\n"
    begin = time.monotonic()
    for _ in range(500):
        server.write(long)
    assert time.monotonic() - begin < 2.0
    client.settimeout(20.0)
    received = []
    with client, client.makefile(encoding="utf-8") as stream:
        for line in stream:
            received.append(line)
            if len(received) == 5:
                server.write("last\n")
                server.close()
    dropped = sum(json.loads(line)["lines"] for line in received if line.startswith("{"))
    assert dropped > 0
    assert received.count(long) + ("last\n" in received) + dropped == 501


def test_disconnected_client_is_removed():
    server = LineServer("127.0.0.1:0")
    server.greeting = lambda: "hello\n"
    client = connect(server)
    client.recv(6)
    client.close()
    for _ in range(50):
        server.write("x" * 1000 + "\n")
        time.sleep(0.01)
    assert not server._clients
    server.close()


def test_a_closed_service_does_not_listen():
    server = LineServer("127.0.0.1:0")
    server.close()
    with pytest.raises(OSError, match="refused"):
        connect(server)
    assert not server._thread.is_alive()


@pytest.mark.skipif(not Path("/proc/net/if_inet6").exists(), reason="this computer has no IPv6")
def test_an_address_of_ipv6_is_served():
    server = LineServer("[::1]:0")
    server.greeting = lambda: "hello\n"
    assert server.address.startswith("[::1]:")
    with connect(server) as client:
        assert client.recv(6) == b"hello\n"
    server.close()


@pytest.mark.parametrize("address", ["5555", ":5555", "localhost:x", "localhost:70000"])
def test_a_malformed_address_is_refused(address):
    with raises_code(ConfigurationError, "connection.serve_address"):
        LineServer(address)


def test_a_port_in_use_is_refused():
    server = LineServer("127.0.0.1:0")
    with raises_code(ConfigurationError, "connection.serve_unavailable"):
        LineServer(server.address)
    server.close()

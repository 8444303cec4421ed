"""Who sees the page, who may stop a scan from it, and what ten viewers cost."""

import gzip
import http.client
import json
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from rig.commands.options import WithWeb
from rig.errors import UsageError
from rig.live.web import server as web_server
from rig.live.web.address import Address, address
from rig.live.web.server import Server, Site

TOKEN = "a-token-of-a-test"


class Scan:
    """What is served: it counts how often it is asked, and who asks for a stop."""

    def __init__(self):
        self.made, self.stops, self.number = 0, [], 0

    def state(self):
        self.made += 1
        return {"number": self.number, "long": "x" * 100_000}

    def stop(self, who):
        self.stops.append(who)
        return len(self.stops) < 3


@pytest.fixture
def served(request):
    """A server with or without token; its scan, and a function that asks it."""
    scan, token = Scan(), getattr(request, "param", "")
    where = Address("127.0.0.1", 0, token)
    listening = where.listening()
    port = listening.getsockname()[1]
    server = Server(Site(where.at(port), scan.state, scan.stop), listening)

    def ask(path, method="GET", **headers):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        try:
            connection.request(method, path, headers={"Host": f"127.0.0.1:{port}", **headers})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    yield scan, ask, port
    server._site.asked_s = float("-inf")  # nobody looks any more
    server.end()


def test_the_page_and_all_it_needs_are_served_under_a_strict_policy(served):
    _, ask, _ = served
    for path, word in (
        ("/", b"<html"),
        ("/page.css", b"{"),
        ("/page.js", b"import"),
        ("/plots.js", b"export"),
    ):
        status, headers, body = ask(path)
        assert status == 200
        assert word in body
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert b"http://" not in body  # nothing comes from elsewhere
        assert b"https://" not in body
        assert b"innerHTML" not in body
    assert ask("/somewhere")[0] == 404


@pytest.mark.parametrize("name", ["evil.example", "evil.example:8642", "127.0.0.1.evil.example", "[", ""])
def test_a_foreign_name_for_this_computer_is_refused(served, name):
    """A page from elsewhere may have let its own name point here."""
    _, ask, _ = served
    for path in ("/", "/state"):
        assert ask(path, Host=name)[0] == 403


@pytest.mark.parametrize("name", ["localhost:9000", "127.0.0.1:9000", "[::1]:9000", "LOCALHOST"])
def test_another_port_is_no_foreign_name_since_tunnels_have_their_own(served, name):
    _, ask, _ = served
    assert ask("/state", Host=name)[0] == 200


@pytest.mark.parametrize("served", [TOKEN], indirect=True)
def test_without_the_token_nothing_is_said_and_nothing_can_be_stopped(served):
    scan, ask, port = served
    own = {"Origin": f"http://127.0.0.1:{port}"}
    for cookie in ({}, {"Cookie": f"rig-{port}=wrong"}, {"Cookie": f"rig-{port}="}):
        assert ask("/state", **cookie)[0] == 403
        assert ask("/stop", "POST", **own, **cookie)[0] == 403
    assert (scan.made, scan.stops) == (0, [])
    assert "Set-Cookie" not in ask("/?token=wrong")[1]
    assert TOKEN.encode() not in ask("/")[2]
    given = ask(f"/?token={TOKEN}", Host="rig.example:8642")[1]["Set-Cookie"]
    assert "HttpOnly" in given
    assert "SameSite=strict" in given
    assert ask("/state", Host="rig.example:8642", Cookie=given.split(";")[0])[0] == 200


def test_only_the_page_itself_stops_a_scan(served):
    scan, ask, port = served
    for origin in (
        {},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://["},
        {"Origin": "http://127.0.0.1:1"},
    ):
        assert ask("/stop", "POST", **origin)[0] == 403
    assert ask("/stop", Origin=f"http://127.0.0.1:{port}")[0] == 405
    assert scan.stops == []
    own = {"Origin": f"http://127.0.0.1:{port}"}
    assert [ask("/stop", "POST", **own)[0] for _ in range(3)] == [202, 202, 409]  # the third: it is over
    assert set(scan.stops) == {"127.0.0.1"}


def test_an_answer_comes_when_something_is_new_or_after_a_while(served):
    scan, ask, _ = served
    status, headers, body = ask("/state", **{"Accept-Encoding": "gzip"})
    assert (status, headers["Content-Encoding"]) == (200, "gzip")
    assert json.loads(gzip.decompress(body))["number"] == 0
    version = headers["Rig-Version"]
    began_s = time.monotonic()
    threading.Timer(0.3, lambda: setattr(scan, "number", 1)).start()
    status, headers, body = ask(f"/state?have={version}")
    assert (status, json.loads(body)["number"]) == (200, 1)
    assert time.monotonic() - began_s >= 0.3
    status, headers, body = ask(f"/state?have={headers['Rig-Version']}")
    assert (status, body) == (204, b"")
    assert abs(float(headers["Rig-Now"]) - time.time()) < 10


def test_ten_viewers_and_one_that_does_not_read_cost_one_encoding(served):
    scan, ask, port = served
    version = ask("/state")[1]["Rig-Version"]
    with socket.create_connection(("127.0.0.1", port)) as slow, ThreadPoolExecutor(10) as viewers:
        slow.sendall(f"GET /state HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode() * 20)
        made, began_s = scan.made, time.monotonic()
        found = list(viewers.map(lambda _: ask(f"/state?have={version}")[0], range(10)))
        took_s = time.monotonic() - began_s
    assert found == [204] * 10
    # not more than there are rounds in the time; two more for those that had begun
    assert scan.made - made <= took_s / web_server.EVERY_S + 2


def test_nobody_who_looks_costs_nothing(served):
    scan, _, _ = served
    time.sleep(2 * web_server.EVERY_S)
    assert scan.made == 0


def test_where_others_reach_the_page_it_needs_a_token():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match="another port"):
            address(f"127.0.0.1:{port}")
    here, others = address(f"127.0.0.1:{port}"), address(f"0.0.0.0:{port}")
    assert (here.token, here.url) == ("", f"http://127.0.0.1:{port}/")
    assert len(others.token) > 20
    assert others.token in others.url
    assert socket.gethostname() in others.url
    assert address(f"0.0.0.0:{port}").token != others.token


def test_a_port_that_was_not_asked_for_may_be_taken_before_the_page_is_served():
    assert not address("127.0.0.1").asked
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with Address("127.0.0.1", port, asked=False).listening() as listening:
            assert listening.getsockname()[1] != port
        with pytest.raises(OSError, match="in use"):
            Address("127.0.0.1", port).listening()


@pytest.mark.parametrize("given", ["here", "host.invalid:8642", ":0", "1.2.3.4:99999", "http://x:1"])
def test_what_is_no_address_of_this_computer_is_refused(given):
    with pytest.raises(UsageError, match="--web"):
        address(given)


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        (["--web"], "--web=127.0.0.1"),
        (["--web", "--live"], "--web=127.0.0.1 --live"),
        (["--web", "scan.h5"], "--web=127.0.0.1 scan.h5"),
        (["--web", "0.0.0.0:8642", "scan.h5"], "--web 0.0.0.0:8642 scan.h5"),
        (["--web", ":8642"], "--web :8642"),
        (["--", "--web"], "-- --web"),
    ],
)
def test_web_may_stand_alone_or_be_followed_by_an_address(typed, wanted):
    assert " ".join(WithWeb.with_address(typed)) == wanted

import pytest

from pcsg.view.access import Guard, is_loopback


def test_a_name_of_this_machine_is_let_in_with_any_port():
    guard = Guard("127.0.0.1")
    for host in ("localhost", "localhost:1234", "127.0.0.1:80", "[::1]:9", "127.3.2.1"):
        assert guard.refuses(host, f"http://{host}") is None
        assert guard.refuses(host, None) is None


@pytest.mark.parametrize(
    "host",
    [None, "", "evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "[", "::1"],
)
def test_other_hosts_are_refused(host):
    assert Guard("127.0.0.1").refuses(host, None)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://localhost", "http://localhost:81", "null", "", "["]
)
def test_other_origins_are_refused(origin):
    assert Guard("127.0.0.1").refuses("localhost:80", origin)


def test_a_server_on_the_network_answers_to_its_own_name():
    assert Guard("example.org").refuses("example.org:80", "http://example.org:80") is None
    assert Guard("example.org").refuses("evil.example", None)
    assert Guard("0.0.0.0").refuses("10.0.0.7:80", None) is None


def test_tokens_are_long_and_differ():
    one, two = Guard("localhost"), Guard("localhost")
    assert one.token != two.token
    assert len(one.token) >= 22  # 128 bits
    assert one.knows(one.token)
    assert one.token not in repr(one)
    for wrong in (two.token, one.token[:-1], one.token + "x", "", None, 1, [], "\ud800"):
        assert not one.knows(wrong)


def test_loopback_is_told_from_names_that_look_like_it():
    assert is_loopback("::1")
    assert is_loopback("a.localhost")
    assert not is_loopback("localhost.example")
    assert not is_loopback("0.0.0.0")

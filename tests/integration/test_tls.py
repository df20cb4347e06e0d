"""Both clients and the command line over TLS: certificates, tokens, and what a wrong one says."""

import os
import pathlib
import pickle
import re
import subprocess
import sys

import heliograph as hg
import pytest
from heliograph._wire import link

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests/fault"))

import served  # noqa: E402

ROBOT = pathlib.Path(served.DAEMON).with_name("client_robot")


@pytest.fixture(scope="module")
def place():
    with served.folder() as made:
        yield made


@pytest.fixture(scope="module")
def authority(place):
    return served.Authority(place)


@pytest.fixture(scope="module")
def daemon(place, authority):
    """Mutual TLS: robots by certificate, and both tenants by token."""
    cert, key = authority.sign("server")
    tenants = served.tenants_file(place, "robots certificate robots.example\n")
    flags = ("--listen", "127.0.0.1:0", "--tls-cert", cert, "--tls-key", key)
    mutual = ("--tls-client-ca", authority.pem, "--tenants", tenants)
    with served.served(*flags, *mutual, "--grace", "0") as running:
        yield running


@pytest.fixture(scope="module")
def tls(authority):
    cert, key = authority.sign("robots", "DNS:robots.example")
    return hg.TLS(ca=authority.pem, cert=cert, key=key)


def test_a_certificate_says_who_a_client_is_and_a_token_wins(daemon, tls):
    with hg.connect(daemon.tcp, tls=tls) as robots:
        robots.create_scene("shared name", lifetime="daemon")
        with hg.connect(daemon.tcp, tls=tls, token=served.TOKENS["vision"]) as vision:
            assert vision.scenes() == []
            with vision.create_scene("shared name"):
                assert len(vision.scenes()) == 1
        with hg.connect(daemon.tcp, tls=tls, token=served.TOKENS["robots"]) as again:
            assert [scene.name for scene in again.scenes()] == ["shared name"]


def test_a_pickled_client_connects_the_same_way(daemon, tls):
    with hg.connect(daemon.tcp, tls=tls, token=served.TOKENS["vision"]) as vision:
        with hg.connect(daemon.tcp, tls=tls) as robots:
            assert pickle.loads(pickle.dumps(vision)) is vision
            assert pickle.loads(pickle.dumps(robots)) is robots


def test_a_token_in_a_file_is_read_again(daemon, tls, place):
    path = place / "client-token"
    path.write_text(served.TOKENS["robots"] + "\n")
    with hg.connect(daemon.tcp, tls=tls, token=path) as client:
        assert client.info().max_api == 1
        path.write_text("a-token-that-nobody-has")
        with pytest.raises(hg.Unauthenticated, match="who makes it"):
            client.scenes()
        path.write_text(served.TOKENS["vision"])
        with pytest.raises(hg.Unauthenticated, match="session is not open"):
            client.scenes()
        path.write_text(served.TOKENS["robots"])
        assert client.scenes() is not None


def test_a_daemon_that_is_not_trusted_is_named(daemon, monkeypatch):
    monkeypatch.setattr(link, "RETRY_SECONDS", 0.5)
    with pytest.raises(hg.Unavailable, match="CERTIFICATE_VERIFY_FAILED"):
        hg.connect(daemon.tcp, tls=hg.TLS(), token=served.TOKENS["robots"])


def test_the_cpp_client_speaks_tls(daemon, tls):
    files = [str(path) for path in (tls.ca, tls.cert, tls.key)]
    done = subprocess.run([ROBOT, daemon.tcp, "", *files], capture_output=True, timeout=60)
    assert done.stdout == b"2.5\n", done.stderr
    done = subprocess.run([ROBOT, daemon.tcp, "", "/none"], capture_output=True, timeout=60)
    assert done.returncode == 1 and b"cannot read /none" in done.stderr
    done = subprocess.run([ROBOT, daemon.tcp, "", *files[:2], "/none"], capture_output=True)
    assert done.returncode == 1 and b"cannot read /none" in done.stderr


def test_the_command_line_speaks_tls(daemon, tls, place):
    token = place / "token-of-vision"
    token.write_text(served.TOKENS["vision"])
    command = [sys.executable, "-m", "heliograph", "info", "--address", daemon.tcp]
    command += ["--token-file", token, "--tls-ca", tls.ca, "--tls-cert", tls.cert]
    done = subprocess.run(
        [*command, "--tls-key", tls.key], capture_output=True, text=True, timeout=60, env=os.environ
    )
    assert done.returncode == 0, done.stderr
    assert "api v1" in done.stdout
    assert "vision, weight 1" in done.stdout
    named = [*command, "--tls-key", tls.key, "--tls-server-name", "elsewhere"]
    done = subprocess.run([*named, "--json"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "Hostname Verification Check failed" in done.stderr
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "go together" in done.stderr


def test_the_commands_of_the_operators_page_work(place):
    page = (ROOT / "docs/operations.md").read_text()
    folder = place / "page"
    folder.mkdir()

    def shell(command):
        return subprocess.check_output(["bash", "-ec", command], cwd=folder, text=True)

    found = re.search(r"openssl req -x509.*?server\.pem\n", page, re.DOTALL)
    shell(found[0].replace("DNS:node7", "IP:127.0.0.1"))
    make_token = re.search(r"`(token=\$\(openssl rand.*?sha256sum)`", page)[1]
    hashed, token = shell(make_token + '; echo "$token"').split()[::2]
    example = re.search(r"( {4}# tenant.*?)\n\n", page, re.DOTALL)[1]
    tenants = re.sub("sha256:[0-9a-f]+", f"sha256:{hashed}", example)
    served.write(folder / "tenants", tenants + "\n")
    files = {"--tls-cert": "server.pem", "--tls-key": "server.key", "--tenants": "tenants"}
    flags = [word for flag, name in files.items() for word in (flag, folder / name)]
    with served.served("--listen", "127.0.0.1:0", *flags, folder=folder) as running:
        tls = hg.TLS(ca=folder / "server.pem")
        with hg.connect(running.tcp, token=token, tls=tls) as client:
            assert client.info().max_api == 1
        with hg.connect(running.socket) as client:  # "ops socket"
            assert client.info().max_api == 1

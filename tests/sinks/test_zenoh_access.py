"""Zenoh with certificates, users, passwords and access control: real sessions at real routers."""

from __future__ import annotations

import json
import logging
import re
import time
import uuid
from collections.abc import Iterator

import pytest
import zenoh
from pydantic import ValidationError

from pipeline.cli.fleet import read_network
from pipeline.errors import InputError, RunError
from pipeline.fleet.listener import FleetListener
from pipeline.verdict import Cause, Event, Level, Status
from pipeline.zenoh_network import NetworkSettings, session_config
from pipeline.zenoh_reach import Network
from sinks.zenoh import ZenohSettings, ZenohSink
from sinks.zenoh_echo import Echo
from sources.zenoh.settings import ZenohSourceSettings
from sources.zenoh.source import ZenohSource
from tests.network import EXAMPLES, free_endpoint, routing, wait_for
from tests.programs import ROOT, inside, syncwatch

FILES = ROOT / "tests" / "data" / "tls"
OWN = {"root_ca": "authority.pem", "certificate": "cart.pem", "private_key": "cart.key"}
PASSWORDS = {"cart": "axle-grease-42", "drone": "rotor-wash-17", "monitor": "night-shift-99"}


def status(rig: str = "cart") -> Status:
    return Status(rig, 1, Level.OK, (), {}, {}, "0", 1.0, 0)


def event(number: int, rig: str = "cart") -> Event:
    return Event(rig, f"x-{number}", "async", "onset", "a-b", "b", Cause.SLIP, number, None, {}, f"event {number}")


@pytest.fixture(scope="module")
def users(tmp_path_factory) -> str:
    file = tmp_path_factory.mktemp("router") / "users.txt"
    file.write_text("".join(f"{user}:{password}\n" for user, password in PASSWORDS.items()))
    return str(file)


@pytest.fixture(scope="module")
def gate(users) -> Iterator[dict[str, str]]:
    """Endpoints of a router that wants a user and a password, over TLS a certificate as well."""
    tls, tcp = free_endpoint().replace("tcp/", "tls/"), free_endpoint()
    files = {
        "root_ca_certificate": str(FILES / "authority.pem"),
        "listen_certificate": str(FILES / "router.pem"),
        "listen_private_key": str(FILES / "router.key"),
        "enable_mtls": True,
    }
    with routing([tls, tcp], transport__link__tls=files, transport__auth__usrpwd__dictionary_file=users):
        yield {"tls": tls, "tcp": tcp}


def at(endpoint: str, user: str | None = "cart", **others) -> dict:
    known = {} if user is None else {"user": user, "password": PASSWORDS.get(user, "nobody's")}
    return {"mode": "client", "connect": [endpoint], **known, **others}


def test_a_rig_is_heard_over_mutual_tls_with_a_password_from_a_file(gate, tmp_path, caplog):
    (tmp_path / "password").write_text(PASSWORDS["cart"] + "\n")
    for name in OWN.values():
        (tmp_path / name).write_bytes((FILES / name).read_bytes())
    settings = {"mode": "client", "connect": [gate["tls"]], "user": "cart", "password_file": "password", "tls": OWN}
    prefix = f"test/{uuid.uuid4().hex[:8]}"
    sink = ZenohSink(ZenohSettings(prefix=prefix, **settings), rig="cart", base=tmp_path)
    sink.start()
    (tmp_path / "network.yaml").write_text(json.dumps({**settings, "prefix": prefix}))
    sink.take(event(1))
    listed = inside("events", "--network", "network.yaml", "--for", "1500ms", "--json", cwd=tmp_path)
    sink.stop()
    assert json.loads(listed.stdout)["id"] == "x-1", listed.stderr
    assert caplog.messages == []


@pytest.mark.parametrize(
    ("door", "changes", "said"),
    [
        ("tcp", {"password": "wrong-as-can-be"}, "it does not know user 'cart' with this password"),
        ("tcp", {"user": "stranger"}, "it does not know user 'stranger' with this password"),
        ("tcp", {"user": None, "password": None}, "it asks for a user and a password"),
        ("tls", {"tls": OWN | {"root_ca": "other-authority.pem"}}, "its certificate was not issued by tls.root_ca"),
        (
            "tls",
            {"tls": OWN | {"certificate": "stranger.pem", "private_key": "stranger.key"}},
            "it does not accept our tls.certificate",
        ),
        ("tls", {"tls": {"root_ca": "authority.pem"}}, "it asks for a certificate of ours: tls.certificate"),
        ("tls", {"connect": "tcp"}, "it hangs up: does it expect tls/"),
        ("tls", {"connect": "name"}, "there is no host of this name"),
    ],
    ids=["password", "user", "no user", "authority", "stranger", "no certificate", "tcp", "name"],
)
def test_why_a_router_cannot_be_used_is_said(gate, door, changes, said):
    settings = at(gate[door]) | ({"tls": OWN} if door == "tls" and "connect" not in changes else {}) | changes
    if door == "tls" and "connect" in changes:
        other = {"tcp": gate["tls"].replace("tls/", "tcp/"), "name": "tcp/nowhere.invalid:7447"}
        settings["connect"] = [other[changes["connect"]]]
    network = Network(NetworkSettings.model_validate(settings), FILES)
    with pytest.raises(zenoh.ZError):
        network.open()
    assert network.why_not().startswith(said)


def test_a_certificate_of_another_host_is_refused_unless_told_otherwise():
    endpoint = free_endpoint().replace("tcp/", "tls/")
    files = {"listen_certificate": str(FILES / "elsewhere.pem"), "listen_private_key": str(FILES / "elsewhere.key")}
    settings = at(endpoint, user=None, tls={"root_ca": "authority.pem"})
    with routing([endpoint], transport__link__tls=files):
        network = Network(NetworkSettings.model_validate(settings), FILES)
        assert network.why_not() == "its certificate is for another host (tls.verify_name)"
        settings["tls"]["verify_name"] = False
        with Network(NetworkSettings.model_validate(settings), FILES).open() as session:
            assert list(session.info.routers_zid())


def test_a_peer_that_listens_knows_its_users(users):
    endpoint = free_endpoint()
    with zenoh.open(session_config(NetworkSettings(listen=[endpoint], users_file=users))):
        for password, said in ((PASSWORDS["cart"], ""), ("wrong-as-can-be", "it does not know user 'cart'")):
            network = Network(NetworkSettings.model_validate(at(endpoint, password=password)))
            assert network.why_not().startswith(said)
            assert bool(network.why_not()) == bool(said)


def test_a_wrong_password_is_one_line_and_never_the_password(gate, caplog, monkeypatch):
    monkeypatch.setattr("sinks.zenoh_link.REQUIRED_WITHIN_S", 0.0)
    caplog.set_level(logging.DEBUG)
    settings = at(gate["tcp"]) | {"password": "wrong-as-can-be"}
    sink = ZenohSink(ZenohSettings(**settings), rig="cart")
    sink.start()
    source = ZenohSource(
        ZenohSourceSettings.model_validate({**settings, "cameras": {"left": {"key": "left", "fps": 30}}})
    )
    source.open()
    with FleetListener(ZenohSettings(**settings)) as listener:
        wait_for(lambda: "password" in (listener.problem or ""))
    source.close()
    sink.stop()
    reason = "(it does not know user 'cart' with this password)"
    warned = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert warned == [f"zenoh: cannot reach {gate['tcp']} yet, trying on {reason}"] * 2
    assert listener.problem == f"cannot reach {gate['tcp']}: {reason[1:-1]}"
    assert "wrong-as-can-be" not in caplog.text + repr(sink.__dict__) + repr(listener.settings)
    with pytest.raises(RunError, match=re.escape(reason[1:-1])):
        ZenohSink(ZenohSettings(**settings, required=True), rig="cart").start()


@pytest.mark.parametrize("known_by", ["usernames", "cert_common_names"])
def test_no_rig_can_publish_as_another(known_by, users, tmp_path, caplog):
    example = tmp_path / "router.json5"
    text = (EXAMPLES / "fleet" / "access-by-rig.json5").read_text()
    others: dict = {"transport__auth__usrpwd__dictionary_file": users}
    endpoint = free_endpoint()
    if known_by == "cert_common_names":
        endpoint = endpoint.replace("tcp/", "tls/")
        text = text.replace('usernames: ["', 'cert_common_names: ["').replace('"monitor"] }', '"elsewhere"] }')
        files = {
            "root_ca_certificate": str(FILES / "authority.pem"),
            "listen_certificate": str(FILES / "router.pem"),
            "listen_private_key": str(FILES / "router.key"),
            "enable_mtls": True,
        }
        others |= {"transport__link__tls": files, "transport__auth__usrpwd": {}}
    example.write_text(text)

    def known(name: str) -> ZenohSettings:
        if known_by == "usernames":
            return ZenohSettings(**at(endpoint, user=name))
        person = name.replace("monitor", "elsewhere")
        tls = {"root_ca": "authority.pem", "certificate": f"{person}.pem", "private_key": f"{person}.key"}
        return ZenohSettings(
            **at(endpoint, user=None, tls={key: str(FILES / file) for key, file in tls.items()}),
        )

    with routing([endpoint], example, **others):
        cart, drone = (ZenohSink(known(name), rig=name) for name in ("cart", "drone"))
        impostor = ZenohSink(known("drone"), rig="cart")
        impostor.start()
        cart.start()
        drone.start()
        for number in range(10):
            cart.take(event(number))
        with FleetListener(known("monitor")) as heard:
            wait_for(lambda: heard.fleet.rig("cart") and len(heard.fleet.rig("cart").incidents) == 10)
            impostor.take(event(999))
            impostor.take(status())
            for _ in range(16):
                cart.take(status())
                drone.take(status("drone"))
                impostor.take(Status("cart", 1, Level.ERROR, ("a lie",), {}, {}, "0", 1.0, 0))
                time.sleep(0.15)
            wait_for(lambda: heard.fleet.rig("drone") and heard.fleet.rig("drone").status)
            assert heard.fleet.rig("cart").status.level is Level.OK
            assert [incident.id for incident in heard.fleet.rig("cart").incidents] == [f"x-{n}" for n in range(10)]
            with Network(known("monitor")).open() as session:
                replies = list(session.get("syncwatch/cart/**", timeout=1))
            answers = [reply.ok.payload.to_string() for reply in replies if reply.ok]
        for sink in (cart, drone, impostor):
            sink.stop()
    assert len(answers) == 2
    assert not any("a lie" in answer for answer in answers)
    said = [message for message in caplog.messages if "passes nothing of ours on" in message]
    assert len(said) == 1, caplog.messages
    assert f"zenoh: {endpoint} is reached" in said[0]
    assert ("user 'drone'" in said[0]) == (known_by == "usernames")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"tls": OWN | {"root_ca": "none.pem"}}, "zenoh: tls.root_ca: FILES/none.pem: there is no such file"),
        ({"tls": OWN | {"root_ca": "cart.key"}}, "zenoh: tls.root_ca: FILES/cart.key: no certificate in it"),
        (
            {"tls": OWN | {"private_key": "drone.key"}},
            "zenoh: tls.private_key: FILES/drone.key: is not the key of the certificate FILES/cart.pem",
        ),
        ({"tls": OWN | {"private_key": "README.md"}}, "zenoh: tls.certificate: FILES/cart.pem and its private_key"),
        ({"user": "cart", "password_file": "none"}, "zenoh: password_file: FILES/none: there is no such file"),
        ({"user": "cart", "password_file": "."}, "zenoh: password_file: FILES: cannot be read: Is a directory"),
        ({"user": "cart", "password_file": "a\0b"}, "zenoh: password_file: 'a\\x00b': cannot be the name of a file"),
        ({"user": "cart", "password": ""}, "zenoh: password: is empty"),
    ],
)
def test_files_that_are_missing_or_no_good_are_said_before_anything_starts(settings, said):
    given = ZenohSettings(mode="client", connect=["tls/127.0.0.1:1"], **settings)
    with pytest.raises(InputError, match=re.escape(said.replace("FILES", str(FILES)))):
        ZenohSink(given, rig="cart", base=FILES)


def test_a_password_file_that_goes_away_is_said_by_whoever_looks_why_nobody_is_reached(tmp_path):
    (tmp_path / "password").write_text("axle-grease-42\n")
    given = {"mode": "client", "connect": [free_endpoint()], "user": "cart", "password_file": "password"}
    network = Network(NetworkSettings.model_validate(given), tmp_path)
    (tmp_path / "password").unlink()
    assert network.why_not() == f"password_file: {tmp_path}/password: there is no such file"
    assert Echo(network, "a").look() is None


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"connect": ["tcp/a:1"], "tls": {}}, "nothing is encrypted"),
        ({"listen": ["tls/a:1"]}, "need tls with a certificate"),
        ({"connect": ["tls/a:1"], "tls": {"certificate": "a"}}, "belong together"),
        ({"connect": ["tls/a:1"], "tls": {"mutual": True}}, "needs a certificate"),
        ({"connect": ["tcp/a:1"], "user": "a"}, "needs a password or a password_file"),
        ({"connect": ["tcp/a:1"], "password": "hunter-2"}, "need a user"),
        ({"connect": ["tcp/a:1"], "user": "a", "password": "hunter-2", "password_file": "b"}, "one of them"),
        ({"user": "a", "password": "hunter-2"}, "connect is empty"),
        ({"connect": ["tcp/a:1"], "listen": ["tcp/a:1"], "user": "a", "password": "hunter-2"}, "users_file has to say"),
        ({"users_file": "a"}, "listen, which is empty"),
        ({"connect": ["tcp/a:1"], "user": "a", "password": 4711}, "put it in quotes"),
        ({"connect": ["tls/a#connect_private_key_base64=hunter-2"]}, "'tls/a' is not an endpoint"),
    ],
)
def test_settings_that_protect_nothing_are_refused_without_repeating_passwords(settings, said):
    with pytest.raises(ValidationError, match=said) as refused:
        ZenohSettings.model_validate(settings)
    assert "hunter" not in str(refused.value)
    assert "4711" not in str(refused.value)


def test_a_key_in_an_endpoint_is_not_shown():
    endpoint = "tls/router:7447#root_ca_certificate_base64=abc;connect_private_key_base64=hunter-2"
    assert ZenohSettings(connect=[endpoint]).where == "tls/router:7447"


HUSH = "hunter-2-the-second"
CONFIG = """
rig: cart
source: {{type: synthetic, duration_s: 0.2, width: 64, height: 48}}
detectors: {{timestamp: {{}}}}
sinks:
  zenoh: {{mode: client, connect: [{endpoint}], user: cart, {more}}}
"""
LITERAL = f"password: {HUSH}"


@pytest.mark.parametrize(
    ("more", "arguments", "status"),
    [
        (LITERAL, (), 0),
        (f"{LITERAL}, prefx: a", (), 2),
        (f"passwort: {HUSH}", (), 2),
        (f"password_file: x, listen: ['tls/a#connect_private_key_base64={HUSH}']", (), 2),
        (f"password: {{a: {HUSH}}}", (), 2),
        (f"password: [{HUSH}", (), 2),
        (f"password: '{HUSH}", (), 2),
        (f"password: !!int {HUSH}", (), 2),
        (f"password: {HUSH}: {HUSH}", (), 2),
        (f"password: {HUSH}, password: {HUSH}", (), 2),
        ("password: ${PASSWORD_THAT_IS_SET}, mode: pear", (), 2),
        (f"password: ${{NAME{HUSH}", (), 2),
        (LITERAL, ("--set", f"sinks.zenoh.passwort={HUSH}"), 2),
        (LITERAL, ("--set", f"sinks.zenoh.password={{a: {HUSH}}}"), 2),
        (LITERAL, ("--set", f"sinks.zenoh.password=[{HUSH}"), 2),
        (LITERAL, ("--set", "sinks.zenoh.password.more=1"), 2),
        (LITERAL, ("--set", f"sinks={{zenoh: {{password: {HUSH}}}}}"), 2),
        (LITERAL, ("--set", f" password: {HUSH}"), 2),
    ],
)
def test_validate_never_prints_a_password(more, arguments, status, tmp_path, monkeypatch):
    monkeypatch.setenv("PASSWORD_THAT_IS_SET", HUSH)
    (tmp_path / "config.yaml").write_text(CONFIG.format(endpoint="tcp/127.0.0.1:1", more=more))
    done = inside("-v", "validate", *arguments, cwd=tmp_path)
    assert (done.returncode, HUSH in done.stdout + done.stderr) == (status, False), done.stdout + done.stderr
    assert done.stdout + done.stderr


def test_a_run_whose_password_is_wrong_says_so_and_prints_it_nowhere(gate, tmp_path):
    """Not even where Zenoh is asked to log everything."""
    (tmp_path / "config.yaml").write_text(CONFIG.format(endpoint=gate["tcp"], more=f"{LITERAL}, required: true"))
    done = syncwatch("-v", "run", cwd=tmp_path, RUST_LOG="trace")
    assert done.returncode == 1
    *_, last = done.stderr.splitlines()
    assert last == (
        f"syncwatch: error: zenoh: cannot reach {gate['tcp']}: it does not know user 'cart' with this password"
    )
    assert HUSH not in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("text", "arguments", "said"),
    [
        ("mode: client", (), "network.yaml:1:1: error: mode: client needs a router"),
        ("connect: [tcp/a:1]\nsinks: {}", (), "network.yaml:2:1: error: sinks: unknown field"),
        ("{}", ("--mode", "client"), "--mode client: needs a router"),
        ("prefix: a//b", (), "network.yaml:1:9: error: prefix: 'a//b' is not a key"),
        (f"password: {HUSH}", (), "need a user"),
        ("connect: [tcp/a:1]\nuser: a\npassword_file: none", (), "password_file: FOLDER/none: there is no such file"),
    ],
)
def test_a_network_file_that_cannot_work_is_refused_with_its_place(text, arguments, said, tmp_path):
    (tmp_path / "network.yaml").write_text(text)
    done = inside("watch", "--once", "--network", "network.yaml", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said.replace("FOLDER", str(tmp_path)) in done.stderr
    assert HUSH not in done.stderr


def test_what_is_said_of_the_network_is_of_publish(tmp_path):
    done = inside("replay", "nothing", "--network", "network.yaml", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (
        2,
        "syncwatch: error: --network is of --publish: without it nothing is sent\n",
    )


@pytest.mark.parametrize(("mode", "taken"), [("", "client"), ("mode: peer", "peer")])
def test_a_network_file_with_a_router_makes_a_client_unless_it_says_otherwise(mode, taken, tmp_path):
    (tmp_path / "network.yaml").write_text(f"connect: [tcp/a:1]\n{mode}\n")
    assert read_network(str(tmp_path / "network.yaml"))["mode"] == taken

"""Only this machine, with the token, from the app's own page, and no name that leads out of the folder."""

import gc
import json
import signal
import socket
import warnings

import pytest
from app_server import EXAMPLE, serving

pytest.importorskip("starlette", reason="the extra app is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside")
    (outside / "secret.csv").write_bytes(EXAMPLE.read_bytes())
    folder = outside / "bench"
    folder.mkdir()
    (folder / "step.csv").write_bytes(EXAMPLE.read_bytes())
    (folder / "link.csv").symlink_to(outside / "secret.csv")
    return folder


@pytest.fixture(scope="module")
def server(folder):
    with serving(folder) as server:
        yield server


def test_it_listens_on_the_loopback_address_only(server):
    for family, address in ((socket.AF_INET, "127.0.0.2"), (socket.AF_INET6, "::1")):
        try:
            with socket.socket(family) as other:
                assert other.connect_ex((address, server.port)) != 0
        except OSError:
            continue  # no such family here
    assert server.request(server.path)[0] == 200


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/api/state", "//", "/wrong/", "/wrong/api/state", "/%2e%2e/"])
def test_without_the_token_nothing_is_told(server, path):
    status, _, body = server.request(path)
    assert status == 403 and b"token" in body and b"step.csv" not in body


def test_the_token_is_long_and_another_one_every_time(server, folder):
    with serving(folder) as other:
        assert other.path != server.path and len(other.path) >= 32


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Host": "evil.example"},
        {"Host": "evil.example:80", "Origin": "http://evil.example:80"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"},
    ],
    ids=str,
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_another_page_is_refused_even_with_the_token(server, headers, method):
    status, _, body = server.request(f"{server.path}api/state", method=method, headers=headers)
    assert status == 403 and b"another page" in body


def test_its_own_page_is_served_with_its_origin(server):
    own = {"Origin": f"http://127.0.0.1:{server.port}", "Sec-Fetch-Site": "same-origin"}
    assert server.request(f"{server.path}api/state", headers=own)[0] == 200


def test_every_answer_forbids_foreign_scripts_frames_and_guesses(server):
    for path in (server.path, f"{server.path}api/state", f"{server.path}page/main.js", "/"):
        _, headers, _ = server.request(path)
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "script-src 'self'" in headers["content-security-policy"] and "unsafe" not in str(headers)
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"
        assert "access-control-allow-origin" not in headers


OUT = ["../secret.csv", "/etc/passwd", "a/../../secret.csv", "..", ".", "", "link.csv", "..\\secret.csv", "a\0b"]


@pytest.mark.parametrize("name", OUT)
def test_no_name_leads_out_of_the_folder(server, name):
    for path, query in (
        ("recording", {"name": name}),
        ("view", {"of": "recording", "name": name}),
        ("view", {"of": "result", "name": name}),
        ("result", {"name": name}),
        ("file", {"name": name, "file": "result.json"}),
        ("export", {"name": name, "format": "csv"}),
        ("inspect", {"fmu": name}),
        ("check", {"name": name}),
        ("compare", {"names": json.dumps([name, name])}),
    ):
        told = server.get(path, **query)
        assert told["status"] == 400 and ("leads out of" in told["error"] or "is no name" in told["error"]), told
    for path, content in (
        ("open", {"name": name}),
        ("change", {"revision": server.get("state")["revision"], "changes": {"recordings": [{"file": name}]}}),
        ("change", {"revision": server.get("state")["revision"], "changes": {"fmu": name}}),
    ):
        assert server.post(path, content)["status"] == 400, (path, name)


@pytest.mark.parametrize("name", ["../x.csv", "x/../../x.csv", "C:\\x\\y.csv"])
def test_a_dropped_file_lands_in_the_folder_under_its_last_name(server, folder, name):
    before = set(folder.parent.iterdir())
    told = server.post("upload", b"time [s],x\n", name=name)
    assert (folder / told["name"]).read_bytes() == b"time [s],x\n" and "/" not in told["name"]
    assert set(folder.parent.iterdir()) == before


@pytest.mark.parametrize("name", ["", ".hidden.csv", "x.sh", "x.html", "..", "x" * 300 + ".csv"])
def test_a_file_that_is_no_recording_by_its_name_is_not_taken(server, folder, name):
    before = set(folder.iterdir())
    assert server.post("upload", b"#!/bin/sh\n", name=name)["status"] == 400
    assert set(folder.iterdir()) == before


def test_a_dropped_file_never_replaces_another(server, folder):
    assert server.post("upload", EXAMPLE.read_bytes(), name="step.csv") == {"name": "step.csv"}
    assert server.post("upload", b"time [s],y\n", name="step.csv") == {"name": "step-2.csv"}
    assert (folder / "step.csv").read_bytes() == EXAMPLE.read_bytes()


def test_assets_are_those_of_the_page_alone(server):
    for name in ("..%2fserver.py", "server.py", "%2e%2e/server.py", "..%5cserver.py", ""):
        assert server.request(f"{server.path}page/{name}")[0] in (403, 404)
    assert server.request(f"{server.path}page/main.js")[0] == 200


def test_a_report_of_another_hand_gets_an_origin_of_its_own_and_no_network(server, folder):
    (folder / "old").mkdir(exist_ok=True)
    (folder / "old" / "result.json").write_text('{"verdict": "ok"}')
    (folder / "old" / "report.html").write_text("<script>fetch('../')</script>")
    path = f"{server.path}api/file?name=old&file=report.html"
    _, headers, _ = server.request(path)
    policy = headers["content-security-policy"]
    assert policy.startswith("sandbox") and "allow-same-origin" not in policy and "default-src 'none'" in policy


@pytest.mark.parametrize("body", [b"{", b"[]", b'"x"', b"{}", b'{"revision": 0, "changes": 3}', b"\xff"])
def test_what_is_no_request_is_told_so(server, body):
    status, _, told = server.request(f"{server.path}api/change", method="POST", body=body)
    assert status in (400, 409) and b"error" in told and b"Traceback" not in told


@pytest.mark.parametrize(
    "query",
    [
        "view?of=case&values=x", "view?of=case&values=[]", "view?of=case&recording=9", "compare?names={",
        "view?of=recording&name=step.csv&signals={", "view?of=recording&name=step.csv&signals=5", "compare?names=[1]",
        "view?of=recording&name=step.csv&from=nan", "view?of=recording&name=step.csv&buckets=x",
        "picture?of=run&name=none", "sample?of=recording&name=step.csv&at=inf",
    ],
)  # fmt: skip
def test_a_query_that_makes_no_sense_is_told_so(server, query):
    status, _, told = server.request(f"{server.path}api/{query}")
    assert status == 400 and "internal" not in json.loads(told)["error"]


def test_a_folder_that_is_not_there_and_a_port_that_is_taken_are_said_in_one_sentence(server, tmp_path, capsys):
    from estimator.cli import main

    assert main(["app", str(tmp_path / "none")]) == 2
    assert "no such folder" in capsys.readouterr().err
    assert main(["app", str(tmp_path), "--port", str(server.port)]) == 2
    assert f"port {server.port} cannot be had" in capsys.readouterr().err
    assert main(["app", str(tmp_path), "--port", "70000"]) == 2
    assert "port 70000 cannot be had" in capsys.readouterr().err


def test_ctrl_c_between_the_address_and_the_first_request_ends_the_app(folder, monkeypatch):
    import uvicorn

    from estimator.app.server import serve

    told, factory = [], uvicorn.Config.get_loop_factory

    def interrupted(config):
        signal.raise_signal(signal.SIGINT)
        return factory(config)

    monkeypatch.setattr(uvicorn.Config, "get_loop_factory", interrupted)
    before = signal.getsignal(signal.SIGINT)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        assert serve(folder, port=0, browser=False, say=told.append) == 0
        gc.collect()
    assert len(told) == 1 and not warned
    assert signal.getsignal(signal.SIGINT) is before

"""The app, served from a folder in a process of its own, and what talks to it without a browser."""

import contextlib
import http.client
import json
import os
import subprocess
from pathlib import Path
from urllib.parse import quote, urlsplit

from forked import ANEW, Forked

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "cml050_step.csv"


class Server:
    """A running app: its address, and requests to it."""

    def __init__(self, process, address):
        self.process, self.address = process, address
        parts = urlsplit(address)
        self.port, self.path = parts.port, parts.path

    def request(self, path, *, method="GET", body=None, headers=None):
        """Return status, headers and body of an answer; `path` is taken as it is."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        with contextlib.closing(connection):
            connection.request(method, path, body=body, headers=headers or {})
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()

    def get(self, path, **query):
        """Return the JSON of an answer, with the token."""
        text = "&".join(f"{name}={quote(str(value), safe='')}" for name, value in query.items())
        return self._json("GET", f"{self.path}api/{path}?{text}", None)

    def post(self, path, content=None, **query):
        """Send JSON, or bytes as they are; return the JSON of the answer."""
        text = "&".join(f"{name}={quote(str(value), safe='')}" for name, value in query.items())
        body = content if isinstance(content, bytes) else json.dumps(content or {}).encode()
        return self._json("POST", f"{self.path}api/{path}?{text}", body)

    def _json(self, method, path, body):
        status, _, content = self.request(path, method=method, body=body)
        told = json.loads(content)
        return told if status == 200 else {"status": status, **told}


@contextlib.contextmanager
def serving(folder, *arguments, anew=False):
    """Serve a folder; end with Ctrl-C and see that the app ends well.

    The commands that it runs are started anew if told so, else forked from a process that has loaded the program.
    """
    environment = {**os.environ, **({ANEW: "1"} if anew else {})}
    reads, writes = zip(os.pipe(), os.pipe(), strict=True)
    with open(os.devnull) as nothing, open(reads[0]) as said, open(reads[1]) as complained:
        command = ("app", str(folder), "--no-browser", *arguments)
        process = Forked(*command, cwd=Path.cwd(), streams=(nothing.fileno(), *writes), env=environment)
        for write in writes:
            os.close(write)
        try:
            address = said.readline().strip()
            assert address.startswith("http://127.0.0.1:"), complained.read()
            yield Server(process, address)
        finally:
            process.send_signal(2)
            try:
                process.wait(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                raise
        errors = complained.read()
    assert process.returncode == 0 and errors == "", errors

"""The app, served from a folder in a process of its own, and what talks to it without a browser."""

import contextlib
import http.client
import json
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote, urlsplit

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
def serving(folder, *arguments):
    """Serve a folder; end with Ctrl-C and see that the app ends well."""
    command = [sys.executable, "-P", "-c", "import sys; from estimator.cli import main; sys.exit(main())"]
    process = subprocess.Popen(
        [*command, "app", str(folder), "--no-browser", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), process.stderr.read()
        yield Server(process, address)
    finally:
        process.send_signal(2)
        try:
            _, errors = process.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    assert process.returncode == 0 and errors == "", errors

"""Access control of the workbench: a token, and requests of its own page only."""

import contextlib
import ipaddress
import secrets
import socket
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import parse_qs, urlsplit

from truepose_workbench.head import own


class Guard:
    """Refuse requests before any part of the page is sent.

    Other sites' scripts can connect to a local port, also as the same origin (DNS rebinding). A
    request must name this machine as its host, come from no other page, and have the token of the
    printed address, which becomes a cookie on the first request.

    Examples
    --------
    >>> guard = Guard("127.0.0.1", 8080)
    >>> guard.refuses([f"localhost:8080"], [], f"/?token={guard.token}", [])
    >>> guard.refuses(["localhost:8080"], [], "/?token=", [])
    'no token: open the address that truepose workbench printed'
    >>> guard.refuses(["evil.example:8080"], [], f"/?token={guard.token}", [])
    'host evil.example:8080 is not this machine'
    """

    def __init__(self, host: str, port: int, title: str = "truepose") -> None:
        own = socket.gethostname().lower()
        self._names = {host.lower(), "localhost", own, f"{own.partition('.')[0]}.local"}
        self._cookie = f"truepose-{port}"
        self._title = title
        self.token = secrets.token_urlsafe(16)
        self.guards = False  #: whether it is installed in a server

    def refuses(
        self, hosts: list[str], origins: list[str], target: str, cookies: list[str]
    ) -> str | None:
        """Return the reason to refuse a request, from its headers' values, or None."""
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return f"host {' '.join(hosts)} is not this machine"
        if any(origin.partition("://")[2].lower() != hosts[0].lower() for origin in origins):
            return f"origin {' '.join(origins)} is another page"
        pairs = (pair.strip().partition("=") for line in cookies for pair in line.split(";"))
        shown = [value for name, _, value in pairs if name == self._cookie]
        if not any(map(self._is_token, [*shown, *_tokens(target)])):
            return "no token: open the address that truepose workbench printed"
        return None

    def _is_own(self, host: str) -> bool:
        """Return whether a header names this machine by address (no lookup) or by its names."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            if name not in self._names:
                ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode("utf-8", "replace"), self.token.encode())

    def _guarded(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def process(connection: Any, request: Any) -> Any:
            said = {name: request.headers.get_all(name) for name in ("Host", "Origin", "Cookie")}
            why = self.refuses(said["Host"], said["Origin"], request.path, said["Cookie"])
            if why is not None:
                return connection.respond(403, f"truepose: {why}\n")
            if "Accept-Encoding" in request.headers:  # the page is changed here
                del request.headers["Accept-Encoding"]
            response = answer(connection, request)
            if response is not None:
                if response.headers.get("Content-Type", "").startswith("text/html"):
                    response.body = own(response.body.decode(), self._title).encode()
                    del response.headers["Content-Length"]
                    response.headers["Content-Length"] = str(len(response.body))
                response.headers["Referrer-Policy"] = "no-referrer"
                if any(map(self._is_token, _tokens(request.path))):
                    cookie = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                    response.headers["Set-Cookie"] = cookie
            return response

        return process

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Install the guard in a server that viser starts meanwhile; viser has no hook for it."""
        from websockets.asyncio import server

        plain: Any = server.serve

        def serve(*args: Any, process_request: Any, **options: Any) -> Any:
            self.guards = True
            return plain(*args, process_request=self._guarded(process_request), **options)

        server.serve = serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            server.serve = plain  # type: ignore[misc]


def _tokens(target: str) -> list[str]:
    return parse_qs(target.partition("?")[2]).get("token", [])

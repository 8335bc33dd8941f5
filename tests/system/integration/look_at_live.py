#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Looks at the page of `watch` as strangers and as a browser: look_at_live.py PORT PROCESS_ID

Strangers get nothing and can write nothing. A headless Chromium is shown a peer that flies: faces, frames that go on, who is
there, colours of what it looks straight at; it fails on any error on the console. Then the program, told to end, ends although
the browser still looks. Nothing is timed. Exit code 77: there is no Chromium here, the rest is as expected.
"""
import os
import pathlib
import signal
import socket
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "support"), str(ROOT / "system/sessions")]
import browser as chromium  # noqa: E402
import look_at_page  # noqa: E402
from look_at_page import expect, failures, is_hue  # noqa: E402


def ask(port, lines, more=b""):
    """The first line of what the server says."""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall("".join(line + "\r\n" for line in lines + [""]).encode() + more)
        return connection.makefile("rb").readline().decode().strip()


def look_as_strangers(port):
    host = f"Host: 127.0.0.1:{port}"
    upgrade = ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="]
    expect(" 200 " in ask(port, ["GET / HTTP/1.1", host]), "the page")
    for method in ("POST", "PUT", "DELETE"):
        said = ask(port, [f"{method} / HTTP/1.1", host, "Content-Length: 1"], b"x")
        expect(" 405 " in said, f"{method}: {said}")
    for path in ("/etc/passwd", "/../../etc/passwd", "/film.db3"):
        said = ask(port, [f"GET {path} HTTP/1.1", host])
        expect(" 200 " not in said, f"{path}: {said}")
    film = "GET /film HTTP/1.1"
    own = f"Origin: http://127.0.0.1:{port}"
    said = ask(port, [film, host, own] + upgrade)
    expect(" 101 " in said, f"its own page: {said}")
    for name, headers in (("a page from elsewhere", [host, "Origin: http://example.com"]), ("no page", [host]),
                          ("a name for this machine", [f"Host: example.com:{port}", f"Origin: http://example.com:{port}"])):
        said = ask(port, [film] + headers + upgrade)
        expect(" 101 " not in said, f"{name}: {said}")
    # Whoever writes on the stream is left: a text frame "x", masked with zeros.
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall("".join(line + "\r\n" for line in [film, host, own] + upgrade + [""]).encode())
        connection.sendall(b"\x81\x81\0\0\0\0x")
        while connection.recv(65536):
            pass


def look(page, port):
    page.open(f"http://127.0.0.1:{port}/")
    page.run("nearmesh.ready")
    page.run(look_at_page.HELP)
    hud = "nearmesh.player.find('hud').dataset"
    page.run(f"test.until(() => Number({hud}.exact) > 0)")
    page.run(f"(async () => {{ const frame = Number({hud}.frame); await test.until(() => Number({hud}.frame) > frame + 1); }})()")
    page.run("test.until(() => document.querySelector('[data-live=processes]').textContent.includes('peer-1'))")
    table = page.run("document.querySelector('[data-live=processes]').textContent")
    expect("publisher" in table and "certified" in table, f"the processes: {table}")
    page.run("nearmesh.player.play(false)")
    for name in ("edges", "asked", "trails"):
        page.run(f"nearmesh.player.options.{name} = false")
    for kind, flag in (("exact", "true"), ("coarse", "false")):
        face = page.run(f"test.largestFace({flag})")
        expect(face and is_hue(face["found"], face["expected"]), f"an {kind} face: {face}")
    time = page.run("test.drawn().then(at => at.time)")
    expect(page.run("test.drawn().then(at => at.time)") == time, "it goes on though it was stopped")
    page.run("nearmesh.player.press({key: 'End', target: document.body, preventDefault() {}})")
    page.run(f"test.until(() => Number({hud}.time) > {time})")


def main():
    port = int(sys.argv[1])
    look_as_strangers(port)
    if chromium.find():
        with chromium.Browser() as page:
            look(page, port)
            failures.extend("console: " + error for error in page.errors)
            os.kill(int(sys.argv[2]), signal.SIGINT)
            page.run("test.until(() => nearmesh.player.live.ended)")
    print("\n".join(failures) or "as expected")
    return 1 if failures else 0 if chromium.find() else 77


if __name__ == "__main__":
    sys.exit(main())

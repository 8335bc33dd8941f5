#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium that is told what to do through a pipe: for tests of pages, and for pictures of them. Needs nothing
but Python and Debian's package chromium. Every error that a page reports, on its console or by an exception, is kept.

browser.py PAGE OUT.png [--size 1280x800] [--script JS] takes a picture: PAGE is a file or an address, and JS is run, and
waited for, before it is taken.
"""
import argparse
import base64
import json
import os
import pathlib
import select
import shutil
import subprocess
import sys
import tempfile
import time

NAMES = ("chromium", "chromium-browser", "google-chrome")


def find():
    """The browser's path, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    def __init__(self, size=(1280, 800)):
        self.profile = tempfile.TemporaryDirectory(prefix="nearmesh_browser_", ignore_cleanup_errors=True)
        to_browser, self.to_browser = os.pipe()
        self.from_browser, from_browser = os.pipe()

        def take_ends():  # Chromium reads commands from 3 and answers on 4
            ends = os.dup(to_browser), os.dup(from_browser)
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        command = [find(), "--headless=new", "--remote-debugging-pipe", "--use-gl=angle", "--use-angle=swiftshader",
                   "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--no-first-run", "--disable-background-networking",
                   "--disable-dev-shm-usage", "--hide-scrollbars", "--force-device-scale-factor=1", f"--user-data-dir={self.profile.name}",
                   f"--window-size={size[0]},{size[1]}"]
        if os.geteuid() == 0:
            command.append("--no-sandbox")
        self.log = open(pathlib.Path(self.profile.name) / "log.txt", "w+")
        self.process = subprocess.Popen(command + ["about:blank"], close_fds=False, preexec_fn=take_ends, stdin=subprocess.DEVNULL,
                                        stdout=self.log, stderr=self.log, env={**os.environ, "HOME": self.profile.name})
        os.close(to_browser)
        os.close(from_browser)
        self.waiting = b""
        self.number = 0
        self.errors = []
        self.events = []
        self.session = None
        target = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self.session = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(domain + ".enable")
        self.call("Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False)

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        try:
            self.session = None
            self.call("Browser.close")
            self.process.wait(20)
        except (OSError, RuntimeError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
        self.log.close()
        self.profile.cleanup()

    def _read(self, until):
        while b"\0" not in self.waiting:
            if not select.select([self.from_browser], [], [], max(0, until - time.monotonic()))[0]:
                raise RuntimeError("the browser does not answer")
            got = os.read(self.from_browser, 1 << 20)
            if not got:
                self.log.seek(0)
                raise RuntimeError("the browser has ended:\n" + self.log.read()[-2000:])
            self.waiting += got
        message, self.waiting = self.waiting.split(b"\0", 1)
        message = json.loads(message)
        kind, told = message.get("method"), message.get("params", {})
        if kind == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description") or details["text"])
        elif kind == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.errors.append(" ".join(str(a.get("value", a.get("description"))) for a in told["args"]))
        elif kind == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.errors.append(told["entry"]["text"])
        if kind:
            self.events.append(kind)
        return message

    def call(self, method, patience_s=180, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to_browser, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + patience_s
        while True:
            answer = self._read(until)
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]

    def open(self, page, patience_s=180):
        address = page if "://" in page else pathlib.Path(page).resolve().as_uri()
        self.events.clear()
        self.call("Page.navigate", url=address)
        until = time.monotonic() + patience_s
        while "Page.loadEventFired" not in self.events:
            self._read(until)

    def run(self, script):
        """The value of an expression, or of the promise that it is."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            details = result["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description") or details["text"])
        return result["result"].get("value")

    def picture(self, path=None):
        """The page as PNG."""
        png = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path:
            pathlib.Path(path).write_bytes(png)
        return png


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page")
    parser.add_argument("out")
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--script", default="")
    options = parser.parse_args()
    if not find():
        print("no Chromium here (Debian package chromium)", file=sys.stderr)
        return 1
    with Browser(tuple(map(int, options.size.split("x")))) as browser:
        browser.open(options.page)
        if options.script:
            result = browser.run(options.script)
            if result is not None:
                print(json.dumps(result))
        browser.picture(options.out)
        for error in browser.errors:
            print(error, file=sys.stderr)
        return 1 if browser.errors else 0


if __name__ == "__main__":
    sys.exit(main())

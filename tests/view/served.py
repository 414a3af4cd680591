"""A server in a process of its own, a browser for its page, and what tests ask both."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

PATIENCE = 120.0
"""Seconds: a guard against hanging, not a promise. Kernels may have to be compiled."""


def wait_for(found, what):
    """Return what a function returns once that is something."""
    end = time.monotonic() + PATIENCE
    while not (value := found()):
        if time.monotonic() > end:
            pytest.fail(f"waited in vain for {what}")
        time.sleep(0.03)
    return value


class Served:
    """A running ``pcsg view``."""

    def __init__(self, process, address):
        self.process = process
        self.address, self.token = address.split("/#token=")
        self.port = int(self.address.rpartition(":")[2])

    @property
    def page(self):
        return f"{self.address}/#token={self.token}"

    def children(self):
        """Return the numbers of the processes that make pictures."""
        done = subprocess.run(
            ["ps", "-ww", "--ppid", str(self.process.pid), "-o", "pid=,args="],
            capture_output=True,
            text=True,
            check=False,
        )
        return [int(line.split()[0]) for line in done.stdout.splitlines() if "spawn_main" in line]


@contextmanager
def serving(path: Path, *options: str) -> Iterator[Served]:
    """Serve a file."""
    process = subprocess.Popen(
        [sys.executable, "-m", "pcsg", "view", str(path), "--no-browser", *options],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        line = process.stderr.readline()
        found = re.search(r"http://\S+", line)
        assert found, line + process.stderr.read()
        yield Served(process, found[0])
    finally:
        process.kill()
        process.communicate()


def open_browser():
    """Return a Chromium and what ends it; skips the test where there is none."""
    api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    system = shutil.which("chromium") or shutil.which("google-chrome")
    player = api.sync_playwright().start()
    try:
        browser = player.chromium.launch(executable_path=system, args=["--no-sandbox"])
    except api.Error as error:
        player.stop()
        pytest.skip(f"there is no Chromium: {str(error).splitlines()[0]}")

    def end():
        browser.close()
        player.stop()

    return browser, end
